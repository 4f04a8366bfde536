"""Errors that are none of the estimate: a truth of another point of the robot, or by another clock."""

import numpy as np

from tbmslam.evaluation.pose_matching import matching_poses
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import FloatArray
from tbmslam.geometry.trajectory import Trajectory

_LEAST_M = 0.02
"""A smaller error needs no explanation, and noise explains it [m]."""
_SHARE = 0.5
"""What is left of an error (root mean square) where most of it, three quarters of its square, is explained."""
_FARTHEST_S = 5.0
"""Clocks that differ by more have hardly a pose in common by their stamps [s]."""
_STEP_S = 0.05
_LEAST_S = 0.02
"""Recorders' delays of some hundredths of a second are no fault [s]."""


def systematic_error(truth: Trajectory, estimate: Trajectory, max_stamp_difference: float) -> str | None:
    """Return in one line which constant explains most of the error; None if none does.

    Parameters
    ----------
    truth, estimate
        Trajectories of one drive.
    max_stamp_difference
        Poses belong together whose stamps differ by no more [s].
    """
    i, j = matching_poses(truth.stamps, estimate.stamps, max_stamp_difference)
    if len(i) < 3:
        return None
    target, poses, stamps = truth.poses[i, :2], estimate.poses[j], estimate.stamps[j]
    before = _left(target, poses[:, :2])
    if before < _LEAST_M:
        return None
    lever, after_lever = _lever_arm(target, poses)
    offset, after_offset = _clock_offset(truth, poses, stamps)
    if min(after_lever, after_offset) > _SHARE * before:
        return None
    if after_lever <= after_offset:
        return (
            f"a point {lever[0]:+.3f} m ahead and {lever[1]:+.3f} m to the left of the robot fits the truth to "
            f"{after_lever:.3f} m instead of {before:.3f} m: the truth may be that of the laser: pass --frame laser"
        )
    return (
        f"stamps {offset:+.2f} s later fit the truth to {after_offset:.3f} m instead of {before:.3f} m: the "
        f"clocks may differ: correct the stamps of one"
    )


def _left(target: FloatArray, points: FloatArray) -> float:
    """Return the root mean square of the distances (N,) that a rigid alignment leaves [m]."""
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
    """Return the offset of the estimate's stamps that fits best [s], and the remaining error [m]."""
    best, least = 0.0, np.inf
    for offset in np.arange(-_FARTHEST_S, _FARTHEST_S + _STEP_S, _STEP_S):
        inside = (stamps + offset >= truth.stamps[0]) & (stamps + offset <= truth.stamps[-1])
        if abs(offset) < _LEAST_S or inside.sum() < 0.5 * len(stamps):
            continue
        target = np.column_stack(
            [np.interp(stamps[inside] + offset, truth.stamps, truth.poses[:, k]) for k in range(2)]
        )
        left = _left(target, poses[inside, :2])
        if left < least:
            best, least = float(offset), left
    return best, least
