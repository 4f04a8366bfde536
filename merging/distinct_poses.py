"""The best of many poses, each somewhere else: greedy non-maximum suppression."""

import numpy as np
import numpy.typing as npt

from tbmslam.se2 import FloatArray, wrap_angles


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
    kept: list[np.intp] = []
    while len(ranked) and len(kept) < count:
        best, ranked = ranked[0], ranked[1:]
        kept.append(best)
        dx, dy, turn = (poses[ranked] - poses[best]).T
        near = (np.hypot(dx, dy) < apart_m) & (np.abs(wrap_angles(turn)) < apart_rad)
        ranked = ranked[~near]
    return np.array(kept, dtype=np.intp)
