"""Non-maximum suppression of poses."""

import math

from tbmslam.kernels import FloatArray, IntArray, kernel


@kernel
def distinct_places(poses: FloatArray, ranked: IntArray, apart_m: float, apart_rad: float, kept: IntArray) -> int:
    """Write the indices of the best poses that have no better pose nearby into ``kept`` (K,); return their number.

    The indices ``ranked`` (N,) of the poses (N, 3) [m, m, rad] are ordered, best first. Poses nearer to each other than
    both limits count as one pose.
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
