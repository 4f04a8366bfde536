"""Errors of an estimated trajectory: absolute (ATE) and relative (RPE).

J. Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012.

A truth of another point of the robot, or of another clock, causes systematic errors. They are detected and named.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.relations import matching_poses
from tbmslam.geometry.se2 import SE2, FloatArray, compose, path_lengths, wrap_angles
from tbmslam.geometry.trajectory import Trajectory, elapsed_times


def fit_rigid(target: npt.ArrayLike, source: npt.ArrayLike) -> tuple[SE2, float]:
    """Return the least-squares rigid motion T_target_source of corresponding points (N, 2), and the best scale.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991, in the plane. The
    best scale is returned, but not applied. For coincident points it is nan.
    """
    target, source = np.asarray(target, dtype=np.float64), np.asarray(source, dtype=np.float64)
    target_mean, source_mean = target.mean(axis=0), source.mean(axis=0)
    p, q = target - target_mean, source - source_mean
    dot, cross = float((p * q).sum()), float((q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]).sum())
    rotation = SE2(0.0, 0.0, float(np.arctan2(cross, dot)))
    spread = float((q**2).sum())
    x, y = target_mean - rotation.apply(source_mean)
    return SE2(float(x), float(y), rotation.theta), float(np.hypot(dot, cross) / spread) if spread > 0.0 else np.nan


class TrajectoryAlignmentError(TbmSlamError):
    """The trajectories have too few common poses."""


@dataclass(frozen=True)
class TrajectoryAlignment:
    """Alignment of an estimated trajectory with a reference."""

    T_reference_estimate: SE2
    """Transform from the estimate's frame to the reference's."""
    points: FloatArray
    """Estimated positions (M, 2) in the reference's frame, in the order of the estimate [m]."""
    errors_m: FloatArray
    """Their distances (M,) from the reference."""
    unmatched: int
    """Number of estimated poses without a pose of the reference at their stamp."""

    @property
    def ate_m(self) -> float:
        """Absolute trajectory error: root mean square of the distances after the alignment [m]."""
        return float(np.sqrt(np.mean(self.errors_m**2)))


def align_trajectories(
    reference: Trajectory, estimate: Trajectory, max_stamp_difference: float = 0.01
) -> TrajectoryAlignment:
    """Align an estimate with a reference by the rigid motion of least squared distances, eq. 3 there.

    Poses belong together when their stamps differ by no more than `max_stamp_difference` seconds, see
    `matching_poses`.
    """
    i, j = matching_poses(reference.stamps, estimate.stamps, max_stamp_difference)
    if len(i) < 2:
        raise TrajectoryAlignmentError(
            f"only {len(i)} of {len(estimate)} poses have a partner within {max_stamp_difference:g} s in the "
            "reference: check that both trajectories are of the same drive and clock"
        )
    target, source = reference.poses[i, :2], estimate.poses[j, :2]
    T_reference_estimate, _ = fit_rigid(target, source)
    points = T_reference_estimate.apply(source)
    return TrajectoryAlignment(T_reference_estimate, points, np.hypot(*(points - target).T), len(estimate) - len(i))


@dataclass(frozen=True)
class RelativeErrors:
    """Errors of the steps of an estimated trajectory."""

    translations_m: FloatArray
    rotations_deg: FloatArray
    """Absolute error (K,) of each step."""


def relative_errors(
    truth: Trajectory,
    estimate: Trajectory,
    *,
    distance: float | None = None,
    seconds: float | None = None,
    max_stamp_difference: float = 0.01,
) -> RelativeErrors:
    """Compare consecutive steps of a given true distance [m] or duration [s] with the truth, eq. 1 there.

    Poses match if their stamps differ by at most `max_stamp_difference` [s]. Raises a `TrajectoryAlignmentError` if the
    trajectories have no common step.
    """
    if (distance is None) == (seconds is None):
        raise ValueError(f"one of distance and seconds must be given, got {distance} and {seconds}")
    step, unit = (distance, "m") if distance is not None else (seconds, "s")
    if step is None or not step > 0.0:
        raise ValueError(f"step must be positive, got {step}")
    i, j = matching_poses(truth.stamps, estimate.stamps, max_stamp_difference)
    true, estimated = truth.poses[i], estimate.poses[j]
    progress = path_lengths(true) if unit == "m" else elapsed_times(estimate.stamps[j])
    ends = _step_ends(progress, step)
    if len(ends) < 2:
        raise TrajectoryAlignmentError(
            f"the {len(i)} common poses of the trajectories span {progress[-1] if len(i) else 0.0:.3g} {unit}, "
            f"less than a step of {step:g} {unit}: choose a shorter step or check stamps and clocks"
        )
    true_x, true_y, true_theta = _motions(true[ends]).T
    x, y, theta = _motions(estimated[ends]).T
    # inverse(true step) @ estimated step: a rotation does not change the length of the difference.
    translations = np.hypot(x - true_x, y - true_y)
    rotations = np.degrees(np.abs(wrap_angles(theta - true_theta)))
    return RelativeErrors(translations, rotations)


def _step_ends(progress: FloatArray, step: float) -> npt.NDArray[np.intp]:
    """Return indices of poses one step apart: each is the first at least one step after the previous."""
    ends = [0] if len(progress) else []
    while ends:
        following = int(np.searchsorted(progress, progress[ends[-1]] + step))
        if following >= len(progress):
            break
        ends.append(max(following, ends[-1] + 1))  # a step may be below the resolution of the numbers
        if ends[-1] >= len(progress):
            ends.pop()
            break
    return np.array(ends, dtype=np.intp)


def _motions(poses: FloatArray) -> FloatArray:
    """Return each pose (N - 1, 3) in the frame of the previous pose."""
    (dx, dy, turn), heading = np.diff(poses, axis=0).T, poses[:-1, 2]
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.column_stack((cosine * dx + sine * dy, cosine * dy - sine * dx, turn))


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of absolute errors, in their unit."""

    rmse: float
    mean: float
    standard_deviation: float
    median: float
    maximum: float
    """The usual statistics, with the standard deviation of the population."""

    @classmethod
    def of(cls, errors: FloatArray) -> "ErrorStatistics":
        """Compute the statistics of errors (N,), N > 0."""
        if not len(errors):
            raise ValueError("errors must hold at least one value, got none")
        return cls(
            rmse=float(np.sqrt(np.mean(errors**2))),
            mean=float(np.mean(errors)),
            standard_deviation=float(np.std(errors)),
            median=float(np.median(errors)),
            maximum=float(np.max(errors)),
        )


_LEAST_M = 0.02  # least error that is explained; smaller errors are noise [m]
_SHARE = 0.5
"""Largest ratio of the remaining RMS error if a constant explains three quarters of the squared error."""
_FARTHEST_S = 5.0  # largest offset of the clocks; beyond it hardly any stamps match [s]
_STEP_S = 0.05
_STEADY = np.radians(5.0)  # largest median deviation of headings of one body from another's [rad]
_AT_CENTRE_M = 1e-3  # distance of the laser from the robot's centre that is none [m]
_FEWEST = 20  # poses; a constant fits fewer by chance


@dataclass(frozen=True)
class SystematicError:
    """A constant that explains most of the error of a trajectory: a point of the robot, or an offset of the clocks."""

    fact: str
    """The constant and the error without it, in words."""
    T_estimate_truth: SE2 | None
    """Pose of the truth's point on the robot, without rotation if the truth's headings are not steady relative to it.

    None if the clocks differ.
    """
    headings_agree: bool = False
    """Whether the truth's headings are steady relative to those of the estimate."""


def systematic_error(truth: Trajectory, estimate: Trajectory, max_stamp_difference: float) -> SystematicError | None:
    """Return the constant that explains most of the error; None if there is none.

    Poses match if their stamps differ by at most `max_stamp_difference` [s].
    """
    i, j = matching_poses(truth.stamps, estimate.stamps, max_stamp_difference)
    if len(i) < _FEWEST:
        return None
    target, poses, stamps = truth.poses[i], estimate.poses[j], estimate.stamps[j]
    before = _left(target[:, :2], poses[:, :2])
    if before < _LEAST_M:
        return None
    lever, after_lever = _lever_arm(target[:, :2], poses)
    offset, after_offset = _clock_offset(truth, poses, stamps)
    if min(after_lever, after_offset) > _SHARE * before:
        return None
    if after_lever <= after_offset:
        turn, spread = _turn_between(target, compose(poses, np.array((*lever, 0.0))))
        agree = spread < _STEADY
        return SystematicError(
            f"a point {lever[0]:+.3f} m ahead and {lever[1]:+.3f} m to the left of the robot fits the truth to "
            f"{after_lever:.3f} m instead of {before:.3f} m",
            SE2(float(lever[0]), float(lever[1]), turn if agree else 0.0),
            agree,
        )
    direction = "later" if offset > 0.0 else "earlier"
    return SystematicError(
        f"stamps {abs(offset):.2f} s {direction} fit the truth to {after_offset:.3f} m instead of {before:.3f} m", None
    )


def remedy_of(
    error: SystematicError,
    truth: Trajectory,
    estimate: Trajectory,
    max_stamp_difference: float,
    frame: str,
    T_robot_sensor: SE2 | None,
) -> str:
    """Return what may have caused a systematic error, and what to do about it; an option only if it would help.

    The truth was read as one of the `frame`, "robot" or "laser". `T_robot_sensor` is the mount of the laser that is
    stated or that the estimate's map was made with; None if unknown.
    """
    T_estimate_truth = error.T_estimate_truth
    if T_estimate_truth is None:
        return "the clocks may differ: correct the stamps of one"
    if T_robot_sensor is None:
        if not error.headings_agree:
            return (
                "the truth may be of another point of the robot: correct it, or give the estimate in its map's folder"
            )
        return f"the truth may be of the laser: pass --frame laser --sensor-pose {_in_options(T_estimate_truth)}"
    if np.hypot(*T_robot_sensor[:2]) < _AT_CENTRE_M:
        pose = _in_options(T_estimate_truth.inverse())
        return (
            "the map was made with the laser at the robot's centre, so its trajectory is of the laser: if the truth is "
            f"of the robot, map again with --sensor-pose {pose}"
        )
    other, of_other = ("laser", T_robot_sensor.inverse()) if frame == "robot" else ("robot", T_robot_sensor)
    i, j = matching_poses(truth.stamps, estimate.stamps, max_stamp_difference)
    moved = compose(truth.poses[i], np.array(of_other))
    points = estimate.poses[j, :2]
    if _left(moved[:, :2], points) <= _SHARE * _left(truth.poses[i, :2], points):
        return f"the truth may be of the {other}: pass --frame {other}"
    return (
        f"the truth may be of another point, or the mount of the laser, {_in_options(T_robot_sensor)}, is wrong: check "
        "both; --sensor-pose states another mount when mapping"
    )


def _in_options(pose: SE2) -> str:
    """Return a pose as an option states it [m, m, deg]."""
    x, y, degrees = round(pose.x, 3), round(pose.y, 3), round(float(np.degrees(pose.theta)), 1)
    return f"{x + 0.0:.3f} {y + 0.0:.3f} {degrees + 0.0:g}"


def _turn_between(target: FloatArray, poses: FloatArray) -> tuple[float, float]:
    """Return the usual rotation from poses (N, 3) to those of a target, and its median deviation [rad]."""
    T_target_source, _ = fit_rigid(target[:, :2], poses[:, :2])
    turns = target[:, 2] - T_target_source.theta - poses[:, 2]
    usual = float(np.angle(np.exp(1j * turns).mean()))
    return usual, float(np.median(np.abs(wrap_angles(turns - usual))))


def _left(target: FloatArray, points: FloatArray) -> float:
    """Return the root mean square of the distances (N,) after a rigid alignment [m]."""
    T_target_source, _ = fit_rigid(target, points)
    return float(np.sqrt(((T_target_source.apply(points) - target) ** 2).sum(axis=1).mean()))


def _lever_arm(target: FloatArray, poses: FloatArray) -> tuple[FloatArray, float]:
    """Return the point (2,) of the robot that fits best and the remaining error [m], by iterated least squares."""
    lever, cosine, sine = np.zeros(2), np.cos(poses[:, 2]), np.sin(poses[:, 2])
    for _ in range(5):
        moved = poses[:, :2] + np.column_stack(
            (cosine * lever[0] - sine * lever[1], sine * lever[0] + cosine * lever[1])
        )
        turn, _ = fit_rigid(target, moved)
        points = turn.apply(moved)
        c, s = np.cos(turn.theta + poses[:, 2]), np.sin(turn.theta + poses[:, 2])
        ones, zeros, centred = np.ones(len(c)), np.zeros(len(c)), points - points.mean(axis=0)
        rows_x = np.column_stack((ones, zeros, -centred[:, 1], c, -s))
        rows_y = np.column_stack((zeros, ones, centred[:, 0], s, c))
        change, *_ = np.linalg.lstsq(np.vstack((rows_x, rows_y)), (target - points).T.ravel(), rcond=1e-6)
        lever = lever + change[3:]
    moved = poses[:, :2] + np.column_stack((cosine * lever[0] - sine * lever[1], sine * lever[0] + cosine * lever[1]))
    return lever, _left(target, moved)


def _clock_offset(truth: Trajectory, poses: FloatArray, stamps: FloatArray) -> tuple[float, float]:
    """Return the offset of the estimate's stamps that fits best [s], and the remaining error [m].

    The error is infinite if no other offset fits better than 0, or if the truth's stamps step back.
    """
    best, least = 0.0, np.inf
    if np.any(np.diff(truth.stamps) < 0.0):
        return best, least
    steps = round(_FARTHEST_S / _STEP_S)
    for offset in _STEP_S * np.arange(-steps, steps + 1):
        inside = (stamps + offset >= truth.stamps[0]) & (stamps + offset <= truth.stamps[-1])
        if inside.sum() < 0.5 * len(stamps):
            continue
        target = np.column_stack(
            [np.interp(stamps[inside] + offset, truth.stamps, truth.poses[:, k]) for k in range(2)]
        )
        left = _left(target, poses[inside, :2])
        if left < least:
            best, least = float(offset), left
    return best, np.inf if best == 0.0 else least
