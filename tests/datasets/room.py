"""A room as a sensor in space sees it."""

import math

import numpy as np

from datasets.clouds import PointCloud, rotation_of
from datasets.odometry.se3 import SE3

HALF_LENGTH, HALF_WIDTH = 4.0, 2.5
LEVEL = SE3(0.3, 0.1, 0.6, 0.0, 0.0, 0.0, 1.0)


def wall_ranges(x, y, angles):
    """Return the range (N,) of the room's walls from a place, in some directions (N,) along the robot's axes."""
    cosines, sines = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        across = np.where(cosines > 0.0, HALF_LENGTH - x, HALF_LENGTH + x) / np.abs(cosines)
        along = np.where(sines > 0.0, HALF_WIDTH - y, HALF_WIDTH + y) / np.abs(sines)
    return np.minimum(across, along)


def room_cloud(T_robot_sensor=LEVEL, *, step_deg=0.4, offset_deg=0.13, rings=(-0.25, -0.02, 0.02), turn_s=None, sign=1):
    """Return the walls, and the floor below them, by rings of some slopes, level whatever the sensor's tilt.

    `turn_s` makes the sensor turn: anticlockwise from straight back, or clockwise with `sign` -1.
    """
    turned = np.radians(offset_deg + np.arange(0.0, 360.0 - 1e-9, step_deg))
    angles = -math.pi + sign * turned
    ranges = wall_ranges(T_robot_sensor.x, T_robot_sensor.y, angles)
    points, times = [], []
    for slope in rings:
        reach = np.minimum(ranges, T_robot_sensor.z / -slope) if slope < 0.0 else ranges
        points.append(np.column_stack((reach * np.cos(angles), reach * np.sin(angles), reach * slope)))
        times.append(turned / (2.0 * math.pi) * (turn_s or 0.0))
    in_robot = np.concatenate(points)
    seen = in_robot @ rotation_of(T_robot_sensor)
    return PointCloud("lidar", 100.0, seen, np.concatenate(times) if turn_s else None)
