"""Perturbations of a recording: changed angles, odometry, scans and mounts, and changed parameters."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import dropwhile
from typing import TypeAlias

import numpy as np

from tbmslam.configuration.parameters import changed, parse_setting
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import Reading

Change: TypeAlias = Callable[[Iterable[Reading]], Iterator[Reading]]

_SEED = 0
_ANGLE_STEP = 0.003  # share of the angle step; 180 / 179 degrees, which converters wrote, differ by twice as much
_ODOMETRY_SCALE = 0.05  # share of the distance
_LATER_S = 30.0
_DROPPED = 0.05  # share of the scans
_RANGE_NOISE_M = 0.01
_MOUNT_M = 0.04
_REVERSED_S, _REVERSED_EVERY_S = 4.0, 60.0
_USUAL_RATIO, _WITHOUT_ODOMETRY_RATIO = 1.1, 1.5


@dataclass(frozen=True)
class Perturbation:
    """A perturbation of a recording or of a parameter."""

    name: str
    change: Change = iter
    """Perturbs the readings; may be pickled."""
    setting: str | None = None
    """A changed parameter of the SLAM, as ``map.resolution=0.1``; None for none."""
    ratio: float = _USUAL_RATIO
    """Largest ratio of the error to the unperturbed error."""
    T_stated_true: SE2 = SE2(0.0, 0.0, 0.0)  # noqa: RUF009 - an immutable tuple
    """Pose of the recorded robot frame in the perturbed robot frame; the truth is of the recorded frame."""


UNPERTURBED = Perturbation("as it is")


def perturbations(settings: Iterable[str] = ()) -> list[Perturbation]:
    """Return all perturbations, the unperturbed recording first."""
    mounts = [(axis, sign * _MOUNT_M) for axis in "xy" for sign in (1, -1)]
    return [
        UNPERTURBED,
        *(_share("angle step", with_angle_step, sign * _ANGLE_STEP) for sign in (1, -1)),
        *(_share("odometry scaled by", with_odometry_scaled, sign * _ODOMETRY_SCALE) for sign in (1, -1)),
        Perturbation("without odometry", without_odometry, ratio=_WITHOUT_ODOMETRY_RATIO),
        Perturbation(f"begun {_LATER_S:g} s later", begun_later),
        Perturbation(f"{100.0 * _DROPPED:g} % of scans dropped", with_scans_dropped),
        Perturbation(f"{100.0 * _RANGE_NOISE_M:g} cm of range noise", with_range_noise),
        *(_mounted(axis, offset) for axis, offset in mounts),
        Perturbation(f"odometry reversed {_REVERSED_S:g} of {_REVERSED_EVERY_S:g} s", with_odometry_reversed),
        *(Perturbation(setting, setting=setting) for setting in settings),
    ]


def with_angle_step(readings: Iterable[Reading], factor: float) -> Iterator[Reading]:
    """Yield readings with another angle step; the first beam keeps its direction, as with --angle-step-deg."""
    for reading in readings:
        scan = reading.scan
        yield reading.with_scan(replace(scan, angle_increment=factor * scan.angle_increment))


def with_odometry_scaled(readings: Iterable[Reading], factor: float) -> Iterator[Reading]:
    """Yield readings with scaled odometry."""
    for reading in readings:
        poses = (reading.T_odom_robot, reading.T_odom_swept)
        before, after = (pose and SE2(factor * pose.x, factor * pose.y, pose.theta) for pose in poses)
        yield replace(reading, T_odom_robot=before, T_odom_swept=after)


def without_odometry(readings: Iterable[Reading]) -> Iterator[Reading]:
    """Yield readings without odometry."""
    for reading in readings:
        yield replace(reading, T_odom_robot=None, T_odom_swept=None)


def begun_later(readings: Iterable[Reading], seconds: float = _LATER_S) -> Iterator[Reading]:
    """Yield the readings without the first seconds of the recording."""
    iterator = iter(readings)
    first = next(iterator, None)
    if first is not None:
        begin = first.scan.stamp + seconds
        yield from dropwhile(lambda reading: reading.scan.stamp < begin, iterator)


def with_scans_dropped(readings: Iterable[Reading], share: float = _DROPPED) -> Iterator[Reading]:
    """Yield readings without a random share."""
    rng = np.random.default_rng(_SEED)
    return (reading for reading in readings if rng.random() >= share)


def with_range_noise(readings: Iterable[Reading], deviation: float = _RANGE_NOISE_M) -> Iterator[Reading]:
    """Yield readings with Gaussian noise on every measured range, limited to positive ranges."""
    rng = np.random.default_rng(_SEED)
    for reading in readings:
        ranges = reading.scan.ranges
        noisy = np.maximum(ranges + rng.normal(0.0, deviation, len(ranges)), 0.0)  # nan and inf stay
        yield reading.with_scan(reading.scan.with_ranges(noisy))


def with_laser_moved(readings: Iterable[Reading], x: float, y: float) -> Iterator[Reading]:
    """Yield readings with a displaced mount of the laser [m]."""
    T_stated_true = SE2(x, y, 0.0)
    for reading in readings:
        yield replace(reading, T_robot_sensor=T_stated_true @ reading.T_robot_sensor)


def with_odometry_reversed(
    readings: Iterable[Reading], seconds: float = _REVERSED_S, every: float = _REVERSED_EVERY_S
) -> Iterator[Reading]:
    """Yield readings whose odometry has the wrong sign of translation for some seconds at the end of every period."""
    begin, before, reported = math.nan, SE2.identity(), SE2.identity()
    for reading in readings:
        pose = reading.T_odom_robot
        if pose is None:
            yield reading
            continue
        if math.isnan(begin):
            begin, before, reported = reading.scan.stamp, pose, pose
        is_wrong = (reading.scan.stamp - begin) % every >= every - seconds
        reported, before = reported @ _reversed(before.to(pose), is_wrong), pose
        swept = reading.T_odom_swept and reported @ _reversed(pose.to(reading.T_odom_swept), is_wrong)
        yield replace(reading, T_odom_robot=reported, T_odom_swept=swept)


def _reversed(motion: SE2, is_wrong: bool) -> SE2:
    return SE2(-motion.x, -motion.y, motion.theta) if is_wrong else motion


def _share(name: str, change: Callable[..., Iterator[Reading]], share: float) -> Perturbation:
    return Perturbation(f"{name} {100.0 * share:+g} %", partial(change, factor=1.0 + share))


def _mounted(axis: str, offset: float) -> Perturbation:
    x, y = (offset if axis == name else 0.0 for name in "xy")
    return Perturbation(
        f"laser {100.0 * offset:+g} cm in {axis}", partial(with_laser_moved, x=x, y=y), T_stated_true=SE2(x, y, 0.0)
    )


def config_with(setting: str | None) -> SlamConfig:
    """Return the default configuration, with one parameter changed by a setting as ``map.resolution=0.1``."""
    config = SlamConfig()
    return config if setting is None else changed(config, parse_setting(setting), "--without")
