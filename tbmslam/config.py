"""Every parameter of the SLAM, and the presets that people choose by name."""

import copy
import difflib
import tomllib
from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from tbmslam.errors import TbmSlamError
from tbmslam.grid_tracker import GridTrackerConfig
from tbmslam.loop_closing import LoopClosingConfig
from tbmslam.mapping import InsertionConfig
from tbmslam.motion import MotionConfig
from tbmslam.particle_tracker import ParticleTrackerConfig
from tbmslam.scan_matching.hill_climbing import HillClimbingConfig
from tbmslam.scan_matching.monte_carlo import MonteCarloConfig
from tbmslam.sensor_model import SensorModelConfig
from tbmslam.surfel_tracker import SurfelTrackerConfig


class ConfigError(TbmSlamError):
    """A configuration that cannot be used."""


class MapConfig(BaseModel):
    """The grid and what beams write into it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    resolution: float = Field(0.05, gt=0, description="side of a cell [m]")
    max_cells: int = Field(200_000_000, gt=0, description="limit on the grid's size; a cell takes 16 bytes")
    sensor_model: SensorModelConfig = SensorModelConfig(
        hit_probability=0.95, hit_quality=0.3, miss_probability=0.02, miss_quality=0.1, wall_blur=0.0
    )
    insertion: InsertionConfig = InsertionConfig(once_per_scan=True)
    keep_conflict: bool = Field(True, description="keep the conflict of hits and misses as the fourth mass")

    @model_validator(mode="after")
    def _check_once_per_scan(self) -> Self:
        if self.insertion.once_per_scan and self.sensor_model.wall_blur > 0.0:
            raise ValueError("sensor_model.wall_blur must be 0 where insertion.once_per_scan is on")
        if self.insertion.once_per_scan and self.sensor_model.combination == "mean":
            raise ValueError("sensor_model.combination must be 'conjunctive' where insertion.once_per_scan is on")
        return self


class KeyframeConfig(BaseModel):
    """When a scan is worth keeping."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    distance: float = Field(0.25, ge=0, description="travelled since the last one [m]")
    angle: float = Field(0.25, ge=0, description="turned since the last one [rad]")


class SlamConfig(BaseModel):
    """The whole configuration of one SLAM run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    preset: str = "default"
    seed: int = Field(0, ge=0, description="of the random numbers that a matcher draws")
    motion: MotionConfig = MotionConfig()
    tracker: Annotated[SurfelTrackerConfig | GridTrackerConfig | ParticleTrackerConfig, Field(discriminator="kind")] = (
        SurfelTrackerConfig()
    )
    keyframes: KeyframeConfig = KeyframeConfig()
    loop_closing: LoopClosingConfig = LoopClosingConfig()
    map: MapConfig = MapConfig()


_VINY_MAP = MapConfig(
    resolution=0.1,
    sensor_model=SensorModelConfig(),
    insertion=InsertionConfig(no_return="free"),
    keep_conflict=False,
)


_TINY_MAP = _VINY_MAP.model_copy(update={"sensor_model": SensorModelConfig(wall_blur=0.5, combination="mean")})
_CREDIBILIST_MAP = _VINY_MAP.model_copy(update={"resolution": 0.05, "sensor_model": SensorModelConfig(wall_blur=0.1)})


def _on_grid(name: str, matcher: MonteCarloConfig | HillClimbingConfig, cells: MapConfig = _VINY_MAP) -> SlamConfig:
    """Return vinySLAM or a relative of it: one hypothesis, every scan written, no loop closed."""
    return SlamConfig(
        preset=name,
        tracker=GridTrackerConfig(matcher=matcher),
        loop_closing=LoopClosingConfig(enabled=False),
        map=cells,
    )


PRESETS: Mapping[str, SlamConfig] = {
    "default": SlamConfig(),
    "viny": _on_grid("viny", MonteCarloConfig()),
    "viny-hc": _on_grid("viny-hc", HillClimbingConfig()),
    "tiny": _on_grid("tiny", MonteCarloConfig(weighting="even"), _TINY_MAP),
    "credibilist": _on_grid("credibilist", HillClimbingConfig(weighting="even", score="disjunctive"), _CREDIBILIST_MAP),
    "particles": SlamConfig(
        preset="particles",
        tracker=ParticleTrackerConfig(),
        keyframes=KeyframeConfig(distance=0.5, angle=0.35),
        loop_closing=LoopClosingConfig(enabled=False),
    ),
}


def preset(name: str) -> SlamConfig:
    """Return a preset by name.

    Raises
    ------
    ConfigError
        When there is none of that name.
    """
    if name not in PRESETS:
        raise ConfigError(f"there is no preset {name!r}; there are {', '.join(PRESETS)}{_suggestion(name, PRESETS)}")
    return PRESETS[name]


def config_from_dict(values: Mapping[str, object]) -> SlamConfig:
    """Read a configuration; what is not given keeps its default.

    Raises
    ------
    ConfigError
        When a key is unknown or a value does not fit, in one line with the key's place.
    """
    try:
        return SlamConfig.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"configuration: {place}: {first['msg']} (got {first['input']!r})") from None


def with_setting(values: Mapping[str, object], setting: str) -> dict[str, object]:
    """Return a configuration's values with one changed by a text like ``map.resolution=0.1``, its value as in TOML.

    Raises
    ------
    ConfigError
        When the text is not of that form or the key does not exist.
    """
    path, equals, text = setting.partition("=")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    if not equals or not path:
        raise ConfigError(f"setting {setting!r} must look like map.resolution=0.1")
    changed = copy.deepcopy(dict(values))
    place: dict[str, object] = changed
    *parents, key = path.split(".")
    for depth, parent in enumerate([*parents, key]):
        if parent not in place:
            raise ConfigError(f"there is no parameter {path!r}{_suggestion(parent, place)}")
        if depth < len(parents):
            below = place[parent]
            if not isinstance(below, dict):
                raise ConfigError(f"there is no parameter {path!r}: {'.'.join(parents[: depth + 1])} is a value")
            place = below
    place[key] = value
    return changed


def _suggestion(name: str, known: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f": did you mean {near[0]!r}?" if near else ""
