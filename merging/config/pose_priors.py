"""Poses that somebody knows, and how maps are laid near them."""

from typing import Annotated, ClassVar

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig, Metres
from tbmslam.io.map_check import MAX_DISTANCE, MAX_TURN

Coordinate = Annotated[float, Field(ge=-MAX_DISTANCE, le=MAX_DISTANCE, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-MAX_TURN, le=MAX_TURN, allow_inf_nan=False)]
KnownPose = tuple[Coordinate, Coordinate, Angle]


class KnownPoseConfig(FrozenConfig):
    """How a map is placed near its known pose.

    Parameters
    ----------
    reach_m, reach_rad
        How far from the known pose the map is searched, at the middle of its walls [m], and how far turned [rad].
    min_wall_m
        With less agreeing wall than this it is laid exactly as told [m].
    """

    PUBLIC: ClassVar = ("reach_m", "reach_rad")

    reach_m: Annotated[float, Field(ge=1e-3, le=1e3)] = 1.0
    reach_rad: Annotated[float, Field(ge=1e-3, le=3.2)] = 0.18
    min_wall_m: Metres = 2.0
