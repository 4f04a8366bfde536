"""Every parameter of the SLAM, and the presets that people choose by name."""

import difflib
from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import Field, model_validator

from tbmslam.adjustment.adjustment_config import AdjustmentConfig
from tbmslam.adjustment.laser_fit_config import LaserFitConfig
from tbmslam.frozen_config import FrozenConfig
from tbmslam.loops.loop_closing import LoopClosingConfig
from tbmslam.mapping import InsertionConfig
from tbmslam.monitoring.blocked_beams import BlockedBeamsConfig
from tbmslam.monitoring.laser_check import LaserCheckConfig
from tbmslam.monitoring.mount_check import MountCheckConfig
from tbmslam.monitoring.odometry_check import OdometryCheckConfig
from tbmslam.parameters import ConfigError, changed
from tbmslam.scan_matching.hill_climbing import HillClimbingConfig
from tbmslam.scan_matching.monte_carlo import MonteCarloConfig
from tbmslam.sensor_model import SensorModelConfig
from tbmslam.tracking.deskew import DeskewConfig
from tbmslam.tracking.forgetting import ForgettingConfig
from tbmslam.tracking.grid_tracker import GridTrackerConfig
from tbmslam.tracking.motion import MotionConfig
from tbmslam.tracking.odometry_noise import OdometryNoiseConfig
from tbmslam.tracking.particle_tracker import ParticleTrackerConfig
from tbmslam.tracking.surfel_tracker import SurfelTrackerConfig

__all__ = ["PRESETS", "ConfigError", "KeyframeConfig", "MapConfig", "SlamConfig", "config_from_dict", "preset"]


class MapConfig(FrozenConfig):
    """The grid and what beams write into it."""

    resolution: float = Field(0.05, ge=0.001, le=10.0, description="side of a cell [m]")
    max_cells: int = Field(
        60_000_000,
        ge=1000,
        description="limit on the grid's size: a map drawn at the end gets coarser cells instead, one that grows while "
        "it is written ends; a cell takes 28 bytes while it is drawn and 16 afterwards",
    )
    # A beam that speaks a little for both contradicts itself, and many that agree would fill a cell with conflict.
    sensor_model: SensorModelConfig = SensorModelConfig(
        hit_probability=1.0, hit_quality=0.274, miss_probability=0.0, miss_quality=0.096, wall_blur=0.0
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


class KeyframeConfig(FrozenConfig):
    """When a scan is worth keeping."""

    distance: float = Field(0.25, ge=0, description="travelled since the last one [m]")
    angle: float = Field(0.25, ge=0, description="turned since the last one [rad]")


class SlamConfig(FrozenConfig):
    """The whole configuration of one SLAM run."""

    preset: str = Field("default", description="what the values below began as; --preset chooses another")
    seed: int = Field(0, ge=0, description="of the random numbers that a matcher draws")
    motion: MotionConfig = MotionConfig()
    deskew: DeskewConfig = DeskewConfig()
    tracker: Annotated[SurfelTrackerConfig | GridTrackerConfig | ParticleTrackerConfig, Field(discriminator="kind")] = (
        SurfelTrackerConfig()
    )
    keyframes: KeyframeConfig = KeyframeConfig()
    forgetting: ForgettingConfig = ForgettingConfig()
    loop_closing: LoopClosingConfig = LoopClosingConfig()
    adjustment: AdjustmentConfig = AdjustmentConfig()
    laser_fit: LaserFitConfig = LaserFitConfig()
    laser_check: LaserCheckConfig = LaserCheckConfig()
    blocked_beams: BlockedBeamsConfig = BlockedBeamsConfig()
    odometry_check: OdometryCheckConfig = OdometryCheckConfig()
    mount_check: MountCheckConfig = MountCheckConfig()
    map: MapConfig = MapConfig()


_VINY_MAP = MapConfig(
    resolution=0.1,
    max_cells=200_000_000,
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
        deskew=DeskewConfig(enabled=False),
        tracker=GridTrackerConfig(matcher=matcher),
        loop_closing=LoopClosingConfig(enabled=False),
        adjustment=AdjustmentConfig(enabled=False),
        laser_fit=LaserFitConfig(enabled=False),
        blocked_beams=BlockedBeamsConfig(enabled=False),
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
        adjustment=AdjustmentConfig(enabled=False),
        laser_fit=LaserFitConfig(enabled=False),
        # Particles are weighed by what cells say, and lean on what a beam says for both.
        map=MapConfig(
            max_cells=200_000_000,
            sensor_model=SensorModelConfig(
                hit_probability=0.95, hit_quality=0.3, miss_probability=0.02, miss_quality=0.1, wall_blur=0.0
            ),
        ),
        blocked_beams=BlockedBeamsConfig(enabled=False),
    ),
    "odometry": SlamConfig(
        preset="odometry",
        motion=MotionConfig(odometry=OdometryNoiseConfig(learning=False)),
        tracker=SurfelTrackerConfig(min_matched=1.0),
        loop_closing=LoopClosingConfig(enabled=False),
        adjustment=AdjustmentConfig(enabled=False),
        laser_fit=LaserFitConfig(enabled=False),
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
        near = difflib.get_close_matches(name, PRESETS, n=1)
        meant = f": did you mean {near[0]!r}?" if near else ""
        raise ConfigError(f"there is no preset {name!r}; there are {', '.join(PRESETS)}{meant}")
    return PRESETS[name]


def config_from_dict(values: Mapping[str, object]) -> SlamConfig:
    """Read a configuration; what is not given keeps its default, or that of the preset it names.

    Raises
    ------
    ConfigError
        When a key is unknown, with the nearest one, or a value does not fit, in one line with the key's place.
    """
    return changed(preset(str(values.get("preset", "default"))), values)
