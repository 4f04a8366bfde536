"""The best of many places, each somewhere else."""

import math

from tbmslam.kernels import FloatArray, IntArray, kernel


@kernel
def distinct_places(poses: FloatArray, ranked: IntArray, apart_m: float, apart_rad: float, kept: IntArray) -> int:
    """Fill ``kept`` with the best of places that are near no better one; return how many these are.

    Places nearer to each other than both limits are one.

    Parameters
    ----------
    poses
        Their poses (N, 3) [m, m, rad].
    ranked
        Their indices (N,), the best first.
    kept
        Room (K,) for the indices of as many as are wanted.
    """
    found = 0
    for index in ranked:
        if found == len(kept):
            break
        x, y, heading = poses[index, 0], poses[index, 1], poses[index, 2]
        is_new = True
        for k in range(found):
            better = kept[k]
            dx, dy = x - poses[better, 0], y - poses[better, 1]
            if abs(dx) > apart_m or math.hypot(dx, dy) >= apart_m:
                continue
            turn = (heading - poses[better, 2] + math.pi) % (2.0 * math.pi) - math.pi
            if abs(turn) < apart_rad:
                is_new = False
                break
        if is_new:
            kept[found] = index
            found += 1
    return found
