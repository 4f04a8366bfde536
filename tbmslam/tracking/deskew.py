"""Compensation of the motion of the robot during a scan.

Without it, a scan during a turn is rotated by a part of the turn. The twist of a robot hardly changes within the tenth
of a second of a scan, so one motion from beam to beam is sufficient.
"""

import math
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan


class DeskewConfig(FrozenConfig):
    """Compensation of the robot's motion during a scan."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="compensate, where the recording holds the time between beams")
    max_speed: float = Field(10.0, gt=0, description="a faster motion during a scan is a jump of the odometry [m/s]")
    max_turn_rate: float = Field(10.0, gt=0, description="as max_speed, for turns [rad/s]")


def deskewed(scan: LaserScan, T_robot_swept: SE2, T_robot_sensor: SE2, config: DeskewConfig) -> LaserScan:
    """Return a scan with the motion of the laser during the scan, in the frame of its first beam.

    `T_robot_swept` is the motion of the robot from the first beam to the last. The scan is unchanged if it does not
    state the time between beams, or if the motion is impossible for a robot.
    """
    steps, sweep = len(scan.ranges) - 1, scan.sweep()
    too_far = math.hypot(T_robot_swept.x, T_robot_swept.y) > config.max_speed * sweep
    if not config.enabled or sweep <= 0.0 or too_far or abs(T_robot_swept.theta) > config.max_turn_rate * sweep:
        return scan
    T_sensor_swept = T_robot_sensor.inverse() @ T_robot_swept @ T_robot_sensor
    vx, vy, omega = T_sensor_swept.log()
    return replace(scan, beam_step=SE2.exp(vx / steps, vy / steps, omega / steps))
