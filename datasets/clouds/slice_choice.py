"""Which slice of a recording's point clouds becomes its scans, and which beams fit the sensor."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from datasets.clouds.cloud_slice import CloudSlice, rotation_of
from datasets.clouds.point_cloud import PointCloud
from datasets.errors import DatasetError
from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2

_HALF_HEIGHT = 0.25
"""Of the slice where no heights are stated, up and down from the sensor [m]; two to four of 16 rings look into it."""
_FLOOR = 0.1
"""What is lower than this above the robot's frame counts as floor where no heights are stated [m]."""
_FEWEST_DIRECTIONS = 0.05
"""Share of the directions in which a slice must hold points: a camera sees an eighth of a turn."""
_STEPS_DEG = (0.2, 0.25, 0.4, 0.5, 1.0)
"""Angles between beams to choose from: those of spinning lidars."""
_FILLED = 0.9
"""Share of the directions in which a degree holds points that the chosen step must fill, too."""
_STEADY = 0.8
"""Share of the points that must be as late as in a steady turn, within the larger of the next two:"""
_LATE_S, _LATE_TURN = 1e-3, 0.02
"""A time [s], and a share of a turn."""
_LEAST_TURN, _MOST_TURN = math.pi / 2.0, 2.2 * math.pi
"""In one cloud [rad]."""


def mounting(T_robot_sensor: SE3 | None, sensor_pose: SE2 | None, upside_down: bool | None) -> SE3:
    """Return where a sensor is mounted in space.

    Parameters
    ----------
    T_robot_sensor
        The mount in tf; None if unknown.
    sensor_pose
        Its place in the plane, to be used instead; height and tilt stay those of tf.
    upside_down
        Whether it hangs, where tf does not know.
    """
    if T_robot_sensor is None:
        hanging = SE3(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) if upside_down else SE3.identity()
        return SE3.from_planar(sensor_pose or SE2.identity()) @ hanging
    if sensor_pose is None:
        return T_robot_sensor
    return SE3.from_planar(sensor_pose) @ SE3.from_planar(T_robot_sensor.planar()).inverse() @ T_robot_sensor


def choose_slice(
    T_robot_sensor: SE3,
    heights: tuple[float, float] | None,
    step_deg: float | None,
    clouds: Sequence[PointCloud],
    topic: str,
) -> CloudSlice:
    """Choose heights and beams for the clouds of a recording.

    Parameters
    ----------
    T_robot_sensor
        Where the sensor is mounted.
    heights
        Lowest and highest point above the robot's frame [m]; None chooses a band around the sensor without floor.
    step_deg
        Angle between beams [degrees]; None chooses the finest one that the points fill.
    clouds
        The first ones of the recording.
    topic
        Name of their topic, for errors.

    Raises
    ------
    DatasetError
        Hardly any point lies between the heights.
    """
    low, high = heights or (T_robot_sensor.z - _HALF_HEIGHT, T_robot_sensor.z + _HALF_HEIGHT)
    if heights is None and T_robot_sensor.z > _FLOOR:
        low = max(low, _FLOOR)
    cut = CloudSlice(T_robot_sensor, low, high)
    _check_walls(cut, clouds, topic)
    step = math.radians(step_deg or _finest_step(cut, clouds))
    cut = replace(cut, angle_step=step, beams=round(2.0 * math.pi / step))
    turns = [turn for cloud in clouds if (turn := _turn(cut, cloud)) is not None]
    if 2 * len(turns) <= len(clouds):
        return cut
    rate = float(np.median([rate for rate, _ in turns]))
    start = float(np.angle(np.exp([1j * first for _, first in turns]).mean()))
    return replace(cut, angle_min=start, angle_step=math.copysign(step, rate), time_step=step / abs(rate))


def _check_walls(cut: CloudSlice, clouds: Sequence[PointCloud], topic: str) -> None:
    shares = [float(np.isfinite(cut.scan(cloud).ranges).mean()) for cloud in clouds]
    if np.median(shares) >= _FEWEST_DIRECTIONS:
        return
    upwards = rotation_of(cut.T_robot_sensor)[2]
    heights = np.concatenate([cloud.points @ upwards for cloud in clouds]) + cut.T_robot_sensor.z
    where = "are empty"
    if len(heights):
        lowest, highest = np.percentile(heights, (5.0, 95.0))
        where = f"lie mostly between {lowest:.2f} and {highest:.2f} m"
    raise DatasetError(
        f"the clouds of {topic} hold hardly any point between {cut.low:.2f} and {cut.high:.2f} m above the robot's "
        f"frame; they {where}: choose heights at which there are walls with --cloud-heights"
    )


def _finest_step(cut: CloudSlice, clouds: Sequence[PointCloud]) -> float:
    """Return the finest angle between beams that leaves hardly any of them without points [degrees]."""
    filled: dict[float, list[float]] = {step: [] for step in _STEPS_DEG}
    for cloud in clouds:
        points, _ = cut.points(cloud)
        if not len(points):
            continue
        angles = np.degrees(np.arctan2(points[:, 1], points[:, 0])) + 180.0
        degrees = len(np.unique(np.floor(angles)))
        for step, shares in filled.items():
            shares.append(len(np.unique(np.floor(angles / step))) * step / degrees)
    return next((step for step, shares in filled.items() if shares and np.median(shares) >= _FILLED), _STEPS_DEG[-1])


def _turn(cut: CloudSlice, cloud: PointCloud) -> tuple[float, float] | None:
    """Return how fast a sensor turns [rad/s] and in which direction it begins [rad]; None if it does not turn."""
    points, times = cut.points(cloud)
    if times is None or len(times) < cut.beams // 4:
        return None
    order = np.argsort(times, kind="stable")
    times, angles = times[order], np.arctan2(points[order, 1], points[order, 0])
    total, lasts = float(np.angle(np.exp(1j * np.diff(angles))).sum()), float(times[-1] - times[0])
    if not (lasts > 0.0 and _LEAST_TURN < abs(total) < _MOST_TURN):
        return None
    rate = total / lasts
    starts = np.exp(1j * (angles - rate * times))
    start = float(np.angle(np.median(starts.real) + 1j * np.median(starts.imag)))
    late_s = np.abs(np.angle(starts * np.exp(-1j * start))) / abs(rate)
    allowed_s = max(_LATE_S, _LATE_TURN * 2.0 * math.pi / abs(rate))
    return (rate, start) if float((late_s <= allowed_s).mean()) >= _STEADY else None
