"""The best of many poses, each somewhere else: greedy non-maximum suppression."""

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray, wrap_angles


def distinct(
    poses: FloatArray, scores: FloatArray, apart_m: float, apart_rad: float, count: int
) -> npt.NDArray[np.intp]:
    """Return which poses are best, the best first, none near a better one.

    Parameters
    ----------
    poses
        (N, 3) [m, m, rad].
    scores
        (N,), the larger the better; of equals, the earlier one is better.
    apart_m, apart_rad
        Poses nearer to each other than both are one place.
    count
        How many are returned at the most.
    """
    ranked = np.argsort(-scores, kind="stable")
    x, y, heading = np.ascontiguousarray(poses[ranked].T)
    free = np.ones(len(ranked), dtype=bool)
    kept: list[int] = []
    for best in range(len(ranked)):
        if len(kept) == count:
            break
        if not free[best]:
            continue
        kept.append(best)
        near = best + 1 + np.flatnonzero(np.abs(x[best + 1 :] - x[best]) <= apart_m)  # few, and asked first
        near = near[np.hypot(x[near] - x[best], y[near] - y[best]) < apart_m]
        free[near[np.abs(wrap_angles(heading[near] - heading[best])) < apart_rad]] = False
    return np.asarray(ranked[kept], dtype=np.intp)
