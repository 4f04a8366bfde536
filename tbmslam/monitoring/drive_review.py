"""Checks of a whole drive: its speed, undetermined motion, scale of the odometry, mount and clock of the laser."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tbmslam.calibration.clock_check import clock_warning, is_late
from tbmslam.calibration.hand_eye import motions_of, sensor_place, turn_lag
from tbmslam.calibration.mount_check import MountChange, MountCheckConfig, mount_changes, mount_warning
from tbmslam.geometry.se2 import FloatArray, differences, path_lengths
from tbmslam.geometry.trajectory import Trajectory, elapsed_times
from tbmslam.kernels import BoolArray, IntArray
from tbmslam.map.keyframes import Keyframes
from tbmslam.monitoring.incidents import EndWarning
from tbmslam.monitoring.odometry_check import OdometryCheckConfig, odometry_scale
from tbmslam.sensing.laser_scan import Corrections
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, informations, odometry

_SPAN_S, _STEP_S = 10.0, 1.0
"""Time over which a speed is measured, and time between its poses: noise of single poses would add to the speed."""
_FASTEST = 4.0
"""Largest usual speed [m/s]: robots that map buildings drive up to 2 m/s, their platforms up to 3 m/s."""
_CONFIRMED_SHARE = 0.5  # share of the speed that odometry must confirm


class UnusualSpeed(NamedTuple):
    """A speed that most robots do not reach: begin of the fastest part of a drive [s], and its speed [m/s]."""

    stamp: float
    speed: float

    def warning(self) -> str:
        """Return the warning."""
        return (
            f"the robot would drive at {self.speed:.1f} m/s for {_SPAN_S:.0f} s: unless it is a fast vehicle such as a "
            f"car, the map is wrong there, or ranges or stamps have another unit"
        )


def unusual_speed(
    stamps: FloatArray, poses: FloatArray, keyframe_stamps: FloatArray, odometry: FloatArray
) -> UnusualSpeed | None:
    """Return the fastest part of a drive if it is faster than most robots; None otherwise, or if odometry confirms it.

    `poses` (N, 3) are those of the robot in the map at times (N,) [s], which may step back, and `odometry` (K, 3) those
    by odometry at the keyframes, nan if unknown.
    """
    times = elapsed_times(stamps)
    # At most one pose per second of the recording: the clock may have stepped over years.
    _, chosen = np.unique(np.floor(times / _STEP_S), return_index=True)
    begins, speeds = _speeds(times[chosen], poses[chosen])
    if not len(speeds):
        return None
    fastest = int(speeds.argmax())
    speed, stamp = float(speeds[fastest]), float(stamps[chosen[begins[fastest]]])
    if speed <= _FASTEST:
        return None
    inside = np.flatnonzero((keyframe_stamps >= stamp) & (keyframe_stamps <= stamp + _SPAN_S))
    steps = np.hypot(*np.diff(odometry[inside, :2], axis=0).T)
    if len(inside) > 1 and np.nansum(steps) >= _CONFIRMED_SHARE * speed * _SPAN_S:
        return None
    return UnusualSpeed(stamp, speed)


def _speeds(times: FloatArray, poses: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the poses (S,) that begin a whole span, and the mean speeds (S,) over the spans [m/s]."""
    travelled = path_lengths(poses)
    ends = np.searchsorted(times, times + _SPAN_S)
    begins = np.flatnonzero(ends < len(times))
    ends = ends[begins]
    speeds: FloatArray = (travelled[ends] - travelled[begins]) / (times[ends] - times[begins])
    return begins, speeds


_SHORTEST_S = 2.0  # shortest interval with a warning; in less time, a constant velocity errs by centimetres [s]
_LARGE_SHARE = 0.1  # share of a drive above which one warning replaces those of its intervals


class UndeterminedMotion(NamedTuple):
    """The parts of a drive whose motion is undetermined."""

    share: float
    """Share of the drive's time, in [0, 1]."""
    intervals: FloatArray
    """Begin and end (S, 2) of each interval that is long enough for a warning [s]."""

    def warnings(self) -> list[EndWarning]:
        """Return a warning for each interval, or one for the whole drive if the share is large."""
        if self.share > _LARGE_SHARE:
            return [EndWarning("motion", f"for {self.share:.0%} of the drive {_UNDETERMINED}")]
        return [
            EndWarning("motion", _UNDETERMINED, begin, end - begin, all_along=False)
            for begin, end in self.intervals.tolist()
        ]


_UNDETERMINED = (
    "neither odometry nor scans determine the motion: the map is unreliable there; record odometry, or "
    "use a laser with a longer range"
)


def undetermined_motion(keyframes: Sequence[TrackedKeyframe]) -> UndeterminedMotion:
    """Return where the motion of a drive is undetermined, by its keyframes from the surfel tracker."""
    stamps = np.array([keyframe.outline.stamp for keyframe in keyframes])
    undetermined = _undetermined_steps(keyframes)
    durations = np.maximum(np.diff(stamps), 0.0)  # a clock may step back
    whole = float(durations.sum())
    share = float(durations[undetermined].sum()) / whole if whole > 0.0 else 0.0
    edges = np.diff(np.concatenate(([False], undetermined, [False])).astype(np.int64))
    intervals = np.column_stack((stamps[np.flatnonzero(edges == 1)], stamps[np.flatnonzero(edges == -1)]))
    return UndeterminedMotion(share, intervals[intervals[:, 1] - intervals[:, 0] >= _SHORTEST_S])


def _undetermined_steps(keyframes: Sequence[TrackedKeyframe]) -> BoolArray:
    """Return which steps (K - 1,) between keyframes are determined by the prior rather than by the scans."""
    without = np.array([keyframe.T_odom_robot is None for keyframe in keyframes], dtype=np.bool_)
    later = keyframes[1:]
    if not without.any():
        return np.zeros(len(later), dtype=np.bool_)
    if all(keyframe.match.information is None for keyframe in later) and any(
        keyframe.match.moved for keyframe in later
    ):
        return np.zeros(len(later), dtype=np.bool_)  # a matcher without information
    of_scans, of_prior = informations(keyframes)
    root = np.linalg.inv(np.linalg.cholesky(of_prior))
    # The least information of the scan relative to the prior.
    gains = np.linalg.eigvalsh(root @ of_scans @ np.swapaxes(root, 1, 2))[:, 0]
    undetermined: BoolArray = (gains < 1.0) & (without[1:] | without[:-1])
    return undetermined


_FEW_KEYFRAMES = 10  # number of scans from which a cell that all of them see as free is free in map.pgm


def standing_warnings(trajectory: Trajectory, keyframes: Keyframes) -> list[EndWarning]:
    """Return a warning if so few scans became keyframes that the map shows little of what was seen."""
    scans, drawn = len(trajectory), len(keyframes)
    if not 0 < drawn < _FEW_KEYFRAMES or scans < _FEW_KEYFRAMES * drawn:
        return []
    text = (
        f"the robot hardly moved ({trajectory.driven():.1f} m): the map is drawn from {drawn} of {scans} scans, so "
        f"that most free space stays unknown in map.pgm; drive the robot, or map again with --set keyframes.distance=0"
    )
    return [EndWarning("standing", text)]


_STEADY = 0.1  # share of the smallest error with a warning; a stated mount that moves by less counts as one mount
_TIME_STEP_S = 0.1  # step of the times in warnings [s]; the end of `--interval` is excluded


class DriveReview:
    """Checks a whole drive, whose warnings have times since `started` [s]; `corrections` were applied to it."""

    def __init__(
        self, mount: MountCheckConfig, lengths: OdometryCheckConfig, started: float, corrections: Corrections
    ) -> None:
        self._mount, self._lengths = mount, lengths
        self._started, self._corrections = started, corrections

    def warnings(
        self, trajectory: Trajectory, keyframes: Keyframes, tracked: Sequence[TrackedKeyframe]
    ) -> list[EndWarning]:
        """Return the warnings for a drive, by its keyframes at their final poses and as tracked."""
        odometry_poses = odometry(tracked)
        found = undetermined_motion(tracked).warnings()
        fast = unusual_speed(trajectory.stamps, trajectory.poses, keyframes.stamps, odometry_poses)
        if fast is not None:
            found.append(EndWarning("speed", fast.warning(), fast.stamp, all_along=False))
        ratio = odometry_scale(tracked, odometry_poses, self._lengths.scale, self._lengths.lengths)
        if ratio != 1.0:
            found.append(EndWarning("scale", _scale_warning(ratio, self._corrections.odometry_scale)))
        return found + self._mount_warnings(trajectory, keyframes, odometry_poses)

    def _mount_warnings(
        self, trajectory: Trajectory, keyframes: Keyframes, odometry_poses: FloatArray
    ) -> list[EndWarning]:
        """Return the warnings for the laser's mount and clock; if the mount changed, only those of its changes."""
        if not self._mount.enabled or len(keyframes) < 2:
            return []
        sensors = keyframes.all_sensor_poses()
        motions = motions_of(keyframes.stamps, odometry_poses, sensors)
        changes = mount_changes(motions, odometry_poses, sensors, self._mount.angle)
        if changes:
            ends = [
                *(float(keyframes.stamps[change.keyframe]) for change in changes),
                float(trajectory.stamps[-1]) + _TIME_STEP_S,
            ]
            return [self._change_warning(changes[: number + 1], ends, keyframes) for number in range(len(changes))]
        if self._mount_moves(keyframes.sensor_poses):
            return []
        place = sensor_place(motions, self._mount.parts, self._mount.motions)
        text = mount_warning(keyframes, motions, place, self._mount)
        found = [EndWarning("mount", text)] if text else []
        # A wrong mount explains part of the lag.
        if place is not None and is_late(place) and not found:
            turned = turn_lag(keyframes.stamps, odometry_poses, sensors, self._mount.parts)
            if late := clock_warning(place, turned, self._corrections.clock_offset):
                found.append(EndWarning("clock", late))
        return found

    def _mount_moves(self, stated: FloatArray) -> bool:
        """Return whether the stated mount (K, 3) of the laser moves by enough to matter to its check.

        Logs round the poses of each line, and the mount is interpolated in tf, so equal mounts differ a little.
        """
        limits = np.array((self._mount.distance, self._mount.distance, self._mount.angle))
        return bool((np.ptp(differences(stated, stated[0]), axis=0) > _STEADY * limits).any())

    def _change_warning(
        self, changes: Sequence[MountChange], ends: Sequence[float], keyframes: Keyframes
    ) -> EndWarning:
        """Return the warning for the last of some changes; `ends` are the stamps at the ends of the parts [s]."""
        number, turn = len(changes), math.degrees(changes[-1].turn)
        x, y, stated = keyframes.sensor_poses[0].tolist()
        yaws = stated + np.cumsum([0.0, *(change.turn for change in changes)])
        before, after = (
            f"--sensor-pose {x:.2f} {y:.2f} {math.degrees(math.remainder(yaw, math.tau)):.0f}" for yaw in yaws[-2:]
        )
        begin = ends[number - 2] - self._started if number > 1 else 0.0
        turned, end = ends[number - 1] - self._started, ends[number] - self._started
        text = (
            f"the laser turned by {abs(turn):.0f} degrees to the {'left' if turn > 0.0 else 'right'} on the robot: "
            f"split the recording there: map the first part with --interval {begin:.1f} {turned:.1f}"
            f"{f' with {before}' if number > 1 else ''}, and the second with --interval {turned:.1f} {end:.1f} "
            f"with {after}"
        )
        return EndWarning("mount change", text, ends[number - 1], all_along=False)


def _scale_warning(ratio: float, scale: float) -> str:
    """Return the warning for a ratio of the lengths by scans and by odometry, which were multiplied by a scale."""
    fact = f"the scans go {_digits(ratio)} times as far as the odometry: one of them has a wrong scale"
    return f"{fact}; if it is the odometry, pass --odometry-scale {_digits(ratio * scale)}"


def _digits(scale: float) -> str:
    """Return a scale as text, with two decimals or two digits."""
    return f"{scale:.2f}" if scale >= 0.1 else f"{scale:.2g}"
