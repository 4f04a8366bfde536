"""All parameters of the SLAM, and its presets."""

import difflib
from collections.abc import Mapping
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from tbmslam.calibration.laser_check import LaserCheckConfig, LaserFitConfig
from tbmslam.calibration.mount_check import MountCheckConfig
from tbmslam.configuration.parameters import ConfigError
from tbmslam.frozen_config import FrozenConfig
from tbmslam.loop_closure.loop_closer import LoopClosingConfig
from tbmslam.map.rendering import InsertionConfig, MapConfig
from tbmslam.monitoring.blocked_beams import BlockedBeamsConfig
from tbmslam.monitoring.odometry_check import OdometryCheckConfig
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig
from tbmslam.related.viny_tracker import GridTrackerConfig, HillClimbingConfig, MonteCarloConfig
from tbmslam.sensing.sensor_model import SensorModelConfig
from tbmslam.tracking.deskew import DeskewConfig
from tbmslam.tracking.forgetting import ForgettingConfig
from tbmslam.tracking.motion_config import MotionConfig
from tbmslam.tracking.odometry_noise import OdometryNoiseConfig
from tbmslam.tracking.surfel_tracker import SurfelTrackerConfig

__all__ = ["PRESETS", "ConfigError", "KeyframeConfig", "SlamConfig", "preset"]


class KeyframeConfig(FrozenConfig):
    """When a scan becomes a keyframe."""

    PUBLIC: ClassVar = ("distance", "angle")

    distance: float = Field(0.25, ge=0, description="distance travelled since the last keyframe [m]")
    angle: float = Field(0.25, ge=0, description="turn since the last keyframe [rad]")


class SlamConfig(FrozenConfig):
    """The whole configuration of one SLAM run."""

    PUBLIC: ClassVar = ("preset", "seed")

    preset: str = Field("default", description="preset from which the values below differ; --preset chooses another")
    seed: int = Field(0, ge=0, description="seed of the random numbers that a matcher draws")
    motion: MotionConfig = MotionConfig()
    deskew: DeskewConfig = DeskewConfig()
    tracker: Annotated[SurfelTrackerConfig | GridTrackerConfig, Field(discriminator="kind")] = SurfelTrackerConfig()
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

    @model_validator(mode="after")
    def _check_tracker(self) -> Self:
        if self.tracker.kind == "grid" and self.map.insertion.once_per_scan:
            raise ValueError(
                "tracker.kind 'grid' needs map.insertion.once_per_scan=false: set both, or use preset viny"
            )
        return self


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
    """Return vinySLAM or a variant: a single hypothesis, all scans inserted, no loop closures."""
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
    """Return a preset by name."""
    if name not in PRESETS:
        near = difflib.get_close_matches(name, PRESETS, n=1)
        meant = f": did you mean {near[0]!r}?" if near else ""
        raise ConfigError(f"there is no preset {name!r}; there are {', '.join(PRESETS)}{meant}")
    return PRESETS[name]
