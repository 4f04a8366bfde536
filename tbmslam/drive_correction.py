"""A whole drive moved along with its keyframes."""

import numpy as np
import numpy.typing as npt

from tbmslam.se2 import SE2, FloatArray


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
    moved = np.empty_like(poses)
    corrections = [
        SE2.from_array(new) @ SE2.from_array(poses[index]).inverse()
        for index, new in zip(anchors, anchor_poses, strict=True)
    ]
    after = np.searchsorted(anchors, np.arange(len(poses)), side="right")
    for index, following in enumerate(after):
        before = max(int(following) - 1, 0)
        correction = corrections[before]
        if 0 < following < len(anchors):
            span = anchors[following] - anchors[before]
            correction = correction.interpolate(corrections[following], float(index - anchors[before]) / float(span))
        moved[index] = correction @ SE2.from_array(poses[index])
    return moved
