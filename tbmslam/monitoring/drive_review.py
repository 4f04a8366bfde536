"""Looks back at a whole drive: its speed, what determined its motion, the odometry's scale and the laser's mounting."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tbmslam.calibration.mount_change import MountChange, mount_changes
from tbmslam.calibration.mount_check import MountCheckConfig, mount_doubt
from tbmslam.geometry.se2 import FloatArray, way_lengths
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.kernels import BoolArray, IntArray
from tbmslam.map.keyframes import Keyframes
from tbmslam.monitoring.incidents import EndWarning
from tbmslam.monitoring.odometry_check import OdometryCheckConfig, odometry_scale
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, odometry

_SPAN_S, _STEP_S = 10.0, 1.0
"""Time over which a speed is taken, and time between the poses that tell it: noise of single poses is no speed."""
_FASTEST = 4.0
"""Robots that map buildings drive up to 2 m/s, and platforms for them 3 m/s at the most [m/s]."""
_CONFIRMED = 0.5
"""Share of the speed that odometry must tell for it to be true."""


class ImpossibleSpeed(NamedTuple):
    """The fastest part of a drive that no robot drives: when it begins [s], and how fast it is [m/s]."""

    stamp: float
    speed: float

    def warning(self) -> str:
        """Return what is said of it."""
        return (
            f"the robot would drive at {self.speed:.1f} m/s for {_SPAN_S:.0f} s, faster than any mapping robot: "
            f"the map is wrong there, or ranges or stamps have another unit"
        )


def impossible_speed(
    stamps: FloatArray, poses: FloatArray, keyframe_stamps: FloatArray, odometry: FloatArray
) -> ImpossibleSpeed | None:
    """Return where a drive is faster than any robot; None if it is nowhere, or where odometry tells so as well.

    Parameters
    ----------
    stamps, poses
        Times (N,) [s], which may step back, and poses (N, 3) of the robot in the map.
    keyframe_stamps, odometry
        Times (K,) [s] and poses (K, 3) of the robot by odometry at keyframes; nan if there was none.
    """
    times = _running(stamps)
    # A pose a second, wherever there is one: a clock may have stepped over years.
    _, chosen = np.unique(np.floor(times / _STEP_S), return_index=True)
    begins, speeds = _speeds(times[chosen], poses[chosen])
    if not len(speeds):
        return None
    fastest = int(speeds.argmax())
    speed, stamp = float(speeds[fastest]), float(stamps[chosen[begins[fastest]]])
    if speed <= _FASTEST:
        return None
    told = np.flatnonzero((keyframe_stamps >= stamp) & (keyframe_stamps <= stamp + _SPAN_S))
    steps = np.hypot(*np.diff(odometry[told, :2], axis=0).T)
    if len(told) > 1 and np.nansum(steps) >= _CONFIRMED * speed * _SPAN_S:
        return None
    return ImpossibleSpeed(stamp, speed)


def _running(stamps: FloatArray) -> FloatArray:
    """Return times since the begin (N,) that never step back [s]."""
    steps = np.maximum(np.diff(stamps, prepend=stamps[:1]), 0.0)
    times: FloatArray = np.cumsum(steps)
    return times


def _speeds(times: FloatArray, poses: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the poses (S,) from which a whole span is left, and the mean speeds (S,) over it [m/s]."""
    ways = way_lengths(poses)
    ends = np.searchsorted(times, times + _SPAN_S)
    begins = np.flatnonzero(ends < len(times))
    ends = ends[begins]
    speeds: FloatArray = (ways[ends] - ways[begins]) / (times[ends] - times[begins])
    return begins, speeds


_LEAST_S = 2.0
"""A robot that goes on as before for less than this errs by centimetres."""
_LEAST_SHARE = 0.1
"""Of a drive, above which all of it is told at once instead of each moment."""


class UndeterminedMotion(NamedTuple):
    """What of a drive is a guess.

    Parameters
    ----------
    share
        Share of the drive's time, in [0, 1].
    spells
        Begin and end (S, 2) of each time that is long enough to be told [s].
    """

    share: float
    spells: FloatArray

    def warnings(self) -> list[EndWarning]:
        """Return what is said of it: each moment, or once of the whole drive where it is much of it."""
        if self.share > _LEAST_SHARE:
            return [EndWarning("motion", f"for {self.share:.0%} of the drive {_UNDETERMINED}")]
        return [
            EndWarning("motion", _UNDETERMINED, begin, end - begin, all_along=False)
            for begin, end in self.spells.tolist()
        ]


_UNDETERMINED = (
    "neither odometry nor scans determine the motion: the map is unreliable there; record odometry, or "
    "use a laser with a longer range"
)


def undetermined_motion(keyframes: Sequence[TrackedKeyframe]) -> UndeterminedMotion:
    """Return where the motion of a drive is not determined, by its keyframes as the surfel tracker left them."""
    stamps = np.array([keyframe.outline.stamp for keyframe in keyframes])
    guessed = _guessed(keyframes)
    lasted = np.maximum(np.diff(stamps), 0.0)  # a clock may step back
    whole = float(lasted.sum())
    share = float(lasted[guessed].sum()) / whole if whole > 0.0 else 0.0
    edges = np.diff(np.concatenate(([False], guessed, [False])).astype(np.int64))
    spells = np.column_stack((stamps[np.flatnonzero(edges == 1)], stamps[np.flatnonzero(edges == -1)]))
    return UndeterminedMotion(share, spells[spells[:, 1] - spells[:, 0] >= _LEAST_S])


def _guessed(keyframes: Sequence[TrackedKeyframe]) -> BoolArray:
    """Return which steps (K - 1,) between keyframes, to the latter of both, are rather guessed than determined."""
    without = np.array([keyframe.T_odom_robot is None for keyframe in keyframes], dtype=np.bool_)
    later = keyframes[1:]
    if not without.any():
        return np.zeros(len(later), dtype=np.bool_)
    unknown = np.zeros((3, 3))
    if all(keyframe.match.information is None for keyframe in later) and any(
        keyframe.match.moved for keyframe in later
    ):
        return np.zeros(len(later), dtype=np.bool_)  # a matcher that does not say
    seen = np.array([unknown if k.match.information is None else k.match.information for k in later]).reshape(-1, 3, 3)
    guess = np.array([keyframe.prior for keyframe in later]).reshape(-1, 3, 3)
    root = np.linalg.inv(np.linalg.cholesky(guess))
    gains = np.linalg.eigvalsh(root @ seen @ np.swapaxes(root, 1, 2))[:, 0]  # of the scan over the guess
    guessed: BoolArray = (gains < 1.0) & (without[1:] | without[:-1])
    return guessed


_BEYOND_S = 0.1
"""Intervals are told in steps of it and exclude their end."""


class DriveReview:
    """Tells what is wrong with a drive as a whole.

    Parameters
    ----------
    mount, lengths
        When the laser's place and the odometry's lengths are worth a warning.
    started
        Stamp from which times are told [s].
    scale
        What the odometry's lengths were multiplied by.
    """

    def __init__(self, mount: MountCheckConfig, lengths: OdometryCheckConfig, started: float, scale: float) -> None:
        self._mount, self._lengths = mount, lengths
        self._started, self._scale = started, scale

    def warnings(
        self, trajectory: Trajectory, keyframes: Keyframes, tracked: Sequence[TrackedKeyframe]
    ) -> list[EndWarning]:
        """Return what is wrong with a drive, by its keyframes at their final poses and as they were tracked."""
        wheels = odometry(tracked)
        found = undetermined_motion(tracked).warnings()
        fast = impossible_speed(trajectory.stamps, trajectory.poses, keyframes.stamps, wheels)
        if fast is not None:
            found.append(EndWarning("speed", fast.warning(), fast.stamp, all_along=False))
        ratio = odometry_scale(tracked, wheels, self._lengths.scale, self._lengths.lengths)
        if ratio != 1.0:
            found.append(EndWarning("scale", _scaled(ratio, self._scale)))
        return found + self._of_mount(trajectory, keyframes, wheels)

    def _of_mount(self, trajectory: Trajectory, keyframes: Keyframes, wheels: FloatArray) -> list[EndWarning]:
        """Return what is wrong with the laser's place on the robot; where it changed, its mean says nothing."""
        if not self._mount.enabled or len(keyframes) < 2:
            return []
        changes = mount_changes(keyframes.stamps, wheels, keyframes.all_sensor_poses(), self._mount.angle)
        if changes:
            ends = [
                *(float(keyframes.stamps[change.keyframe]) for change in changes),
                float(trajectory.stamps[-1]) + _BEYOND_S,
            ]
            return [self._knocked(changes[: number + 1], ends, keyframes) for number in range(len(changes))]
        what = mount_doubt(keyframes, wheels, self._mount)
        return [EndWarning("mount", what)] if what else []

    def _knocked(self, changes: Sequence[MountChange], ends: Sequence[float], keyframes: Keyframes) -> EndWarning:
        """Return the warning of the last of some changes, with the stamps [s] at which the parts of the drive end."""
        number, turn = len(changes), math.degrees(changes[-1].turn)
        x, y, stated = keyframes.sensor_poses[0].tolist()
        yaw = math.remainder(stated + sum(change.turn for change in changes), math.tau)
        begin = ends[number - 2] - self._started if number > 1 else 0.0
        knock, end = ends[number - 1] - self._started, ends[number] - self._started
        what = (
            f"the laser turned by {abs(turn):.0f} degrees to the {'left' if turn > 0.0 else 'right'} on the "
            f"robot: split the recording there: map the first part with --interval {begin:.1f} {knock:.1f}, and the "
            f"second with --interval {knock:.1f} {end:.1f} with --sensor-pose {x:.2f} {y:.2f} {math.degrees(yaw):.0f}"
        )
        return EndWarning("mount change", what, ends[number - 1], all_along=False)


def _scaled(ratio: float, scale: float) -> str:
    """Return what is said where scans go so many times as far as an odometry that was scaled before."""
    told = f"the scans go {_digits(ratio)} times as far as the odometry: one of them has a wrong scale"
    return f"{told}; if it is the odometry, pass --odometry-scale {_digits(ratio * scale)}"


def _digits(scale: float) -> str:
    """Return a scale in words, to a hundredth or two digits."""
    return f"{scale:.2f}" if scale >= 0.1 else f"{scale:.2g}"
