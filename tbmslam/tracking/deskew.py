"""A laser that turns while it is driven sends every beam from another place: take its motion out of the scan.

Without that, a scan taken in a turn is turned by part of the turn itself, to the one side or the other as the robot
turns. Over a scan's tenth of a second the twist of a robot hardly changes, so one motion from beam to beam tells all.
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
    """Return a scan whose beams are sent from where the laser was at their moments.

    Parameters
    ----------
    scan
        The scan; its frame stays that of its first beam. It comes back as it is where it does not tell the time between
        beams, or the motion is none that a robot makes.
    T_robot_swept
        Motion of the robot from the first beam to the last: its pose then in its frame at the first.
    T_robot_sensor
        Pose of the laser on the robot.
    config
        What is done at all.
    """
    steps, sweep = len(scan.ranges) - 1, scan.sweep()
    too_far = math.hypot(T_robot_swept.x, T_robot_swept.y) > config.max_speed * sweep
    if not config.enabled or sweep <= 0.0 or too_far or abs(T_robot_swept.theta) > config.max_turn_rate * sweep:
        return scan
    T_sensor_swept = T_robot_sensor.inverse() @ T_robot_swept @ T_robot_sensor
    vx, vy, omega = T_sensor_swept.log()
    return replace(scan, beam_step=SE2.exp(vx / steps, vy / steps, omega / steps))
