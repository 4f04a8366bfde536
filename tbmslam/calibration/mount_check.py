"""Whether the laser sits on the robot where it is said to, and what would mend it."""

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from tbmslam.calibration.hand_eye import sensor_place, turns
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import FloatArray
from tbmslam.map.keyframes import Keyframes


class MountCheckConfig(FrozenConfig):
    """When odometry and scans contradict the stated mount of the laser."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="compare odometry and scans with the stated mount")
    parts: int = Field(6, ge=2, description="parts of a drive that tell it each by itself")
    motions: int = Field(8, ge=2, description="motions of half a metre that each of them must have")
    distance: float = Field(
        0.15, gt=0, description="distance that is worth a warning [m]; robots that slip as they turn look like 0.1"
    )
    angle: float = Field(math.radians(5.0), gt=0, description="turn that is worth a warning [rad]")
    sure: float = Field(4.0, gt=0, description="standard deviations that both must be, or else it is not known")
    scale: float = Field(
        0.2, gt=0, description="share by which lengths may differ, or else both are no motion of one robot"
    )
    opposed: float = Field(
        0.8, gt=0, le=1, description="how closely both must turn against each other to look upside down, 1 is wholly"
    )
    turning: float = Field(
        2.0 * math.pi, gt=0, description="turning, all in all, without which nothing looks upside down [rad]"
    )


def mount_doubt(keyframes: Keyframes, odometry: FloatArray, config: MountCheckConfig) -> str | None:
    """Return a sentence where the laser sits otherwise on the robot than it is said to; None where it does not.

    Parameters
    ----------
    keyframes
        Scans at their final poses.
    odometry
        Poses (K, 3) of the robot at the same moments as the odometry has them; nan where there was none.
    config
        What is worth a warning.
    """
    if not config.enabled or len(keyframes) < 2 or np.ptp(keyframes.sensor_poses, axis=0).any():
        return None
    sensors = keyframes.all_sensor_poses()
    if _is_turned_over(*turns(keyframes.stamps, odometry, sensors), config):
        return (
            "the scans turn left where the odometry turns right: the laser hangs upside down, and the map is a mirror "
            "image (--upside-down; --no-upside-down where tf says so), or the odometry is wrong (--odometry none)"
        )
    place = sensor_place(keyframes.stamps, odometry, sensors, config.parts, config.motions)
    if place is None or not 1.0 / (1.0 + config.scale) <= place.scale <= 1.0 + config.scale:
        return None
    stated, limits = keyframes.sensor_poses[0].tolist(), (config.distance, config.distance, config.angle)
    apart = [place.pose[0] - stated[0], place.pose[1] - stated[1], math.remainder(place.pose[2] - stated[2], math.tau)]
    # What is not known for sure, as the place of a laser on a robot that hardly turns, stays as it is said to be.
    known = [config.sure * own < limit for own, limit in zip(place.deviations, limits, strict=True)]
    if not any(abs(far) > limit and is_known for far, limit, is_known in zip(apart, limits, known, strict=True)):
        return None
    mended = [there if is_known else said for there, said, is_known in zip(place.pose, stated, known, strict=True)]
    (x, y, turn), (stated_x, stated_y, stated_turn) = _written(mended), _written(stated)
    return (
        f"odometry and scans fit best where the laser sits on the robot at {x}, {y} m, {turn} degrees, "
        f"not at {stated_x}, {stated_y} m, {stated_turn} degrees: try --sensor-pose {x} {y} {turn}"
    )


def _is_turned_over(wheels: FloatArray, seen: FloatArray, config: MountCheckConfig) -> bool:
    """Return whether turns (M,) [rad] that the odometry and the scans tell oppose each other."""
    lengths = math.sqrt(float(wheels @ wheels) * float(seen @ seen))
    enough = min(float(np.abs(wheels).sum()), float(np.abs(seen).sum())) >= config.turning
    return enough and float(wheels @ seen) <= -config.opposed * lengths


def _written(pose: Sequence[float]) -> tuple[str, str, str]:
    """Return a pose in centimetres and degrees, none of them -0."""
    x, y, turn = (
        round(value, digits) + 0.0 for value, digits in ((pose[0], 2), (pose[1], 2), (math.degrees(pose[2]), 0))
    )
    return f"{x:.2f}", f"{y:.2f}", f"{turn:.0f}"
