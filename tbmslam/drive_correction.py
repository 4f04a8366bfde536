"""A whole drive moved along with its keyframes."""

import numpy as np
import numpy.typing as npt

from tbmslam.se2 import FloatArray, compose, interpolate, inverse


def spread_corrections(poses: FloatArray, anchors: npt.NDArray[np.int64], anchor_poses: FloatArray) -> FloatArray:
    """Return the poses (N, 3) of a drive whose anchors were moved; what lies between two anchors follows both.

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
    return compose(between, poses)
