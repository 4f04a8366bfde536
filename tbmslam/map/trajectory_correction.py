"""A whole drive moved along with its keyframes."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray, compose, interpolate, inverse
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive


def spread_corrections(poses: FloatArray, anchors: npt.NDArray[np.int64], anchor_poses: FloatArray) -> FloatArray:
    """Return the poses (N, 3) of a drive after its anchors moved; poses between two anchors follow both.

    Parameters
    ----------
    poses
        Poses (N, 3) as tracked.
    anchors
        Rising indices (K,) of the poses that were moved.
    anchor_poses
        Their new poses (K, 3).
    """
    if len(anchors) == 0:
        return poses.copy()
    corrections = compose(anchor_poses, inverse(poses[anchors]))
    after = np.searchsorted(anchors, np.arange(len(poses)), side="right")
    before, after = np.maximum(after - 1, 0), np.minimum(after, len(anchors) - 1)
    spans = anchors[after] - anchors[before]
    shares = np.where(spans > 0, (np.arange(len(poses)) - anchors[before]) / np.maximum(spans, 1), 0.0)
    between = interpolate(corrections[before], corrections[after], shares)
    moved = compose(between, poses)
    moved[anchors] = anchor_poses  # to the last digit
    return moved


def with_keyframes_at(drive: Drive, poses: FloatArray) -> Drive:
    """Return a drive with other robot poses (K, 3) at its keyframes, and a trajectory that follows them."""
    trajectory, keyframes = drive.trajectory, drive.keyframes
    moved = replace(drive, keyframes=replace(keyframes, poses=poses))
    if len(trajectory) == 0:
        return moved
    corrected = spread_corrections(trajectory.poses, keyframes.indices, poses)
    return replace(moved, trajectory=Trajectory(trajectory.stamps, corrected))
