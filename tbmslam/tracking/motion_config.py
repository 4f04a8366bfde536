"""The configuration of the motion prior."""

from typing import Literal

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.tracking.odometry_noise import OdometryNoiseConfig


class MotionConfig(FrozenConfig):
    """Use and noise of the odometry between two scans."""

    composition: Literal["group", "component"] = Field(
        "group", description="'component' adds x, y and theta one by one as the original program does"
    )
    odometry: OdometryNoiseConfig = OdometryNoiseConfig()
    position_per_second: float = Field(0.5, gt=0, description="position deviation without odometry [m/s]")
    heading_per_second: float = Field(0.5, gt=0, description="initial heading deviation without odometry [rad/s]")
