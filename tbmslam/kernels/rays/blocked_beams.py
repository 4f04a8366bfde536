"""Detection of beams that a part of the robot blocks, from their ranges while the robot moves."""

import math

import numpy as np

from tbmslam.kernels import BoolArray, FloatArray, kernel, part
from tbmslam.kernels.arrays import cleared


@kernel
def follow_beams(
    state: FloatArray, ranges: FloatArray, here: tuple[float, ...], limits: tuple[float, ...], fewest: int
) -> tuple[BoolArray, BoolArray, bool, bool]:
    """Return which beams (B,) are blocked, which are suspected to be blocked, and whether any are.

    Parameters
    ----------
    state
        (6, B): the first range of those that a beam has returned since without a change [m], the index of the reading
        and the distance travelled [m] at that range, the largest and the smallest heading with a return since then
        [rad], and the stamp of that range [s]. The distance also grows by the steps without a return.
    ranges
        The present ranges (B,) [m].
    here
        The present reading's index, distance travelled [m] and heading [rad], the distance since the last scan [m], and
        the stamp [s].
    limits
        Largest difference between constant ranges; largest range; distance and rotation after which a constant beam is
        blocked; largest range, distance and rotation for very near beams [m, rad].
    fewest
        Least number of neighbouring beams that are blocked, or suspected, together.
    """
    index, path_length, turn, step, stamp = here
    spread, near, travelled, turned, very_near, soon, soon_turned = limits
    blocked, suspected = cleared(np.empty(len(ranges), dtype=np.bool_)), cleared(np.empty(len(ranges), dtype=np.bool_))
    for i in range(len(ranges)):
        # A lost beam is no evidence: a laser with a short range sees few things, some at equal ranges by chance.
        if not math.isfinite(ranges[i]):
            state[2, i] += step
        else:
            if not abs(ranges[i] - state[0, i]) <= spread:  # a changed range is not a part of the robot
                state[0, i], state[1, i], state[2, i] = ranges[i], index, path_length
                state[3, i] = state[4, i] = turn
                state[5, i] = stamp
            state[3, i], state[4, i] = max(state[3, i], turn), min(state[4, i], turn)
        if state[0, i] < near:
            length, angle = path_length - state[2, i], state[3, i] - state[4, i]
            suspected[i] = state[0, i] < very_near and length + angle > 0.0
            is_soon = suspected[i] and length >= soon and angle >= soon_turned
            blocked[i] = is_soon or (length >= travelled and angle >= turned)
    return blocked, suspected, _keep_runs(blocked, fewest), _keep_runs(suspected, fewest)


@part
def _keep_runs(marked: BoolArray, fewest: int) -> bool:
    """Remove the runs of fewer than `fewest` marked beams (B,); return whether other marks remain."""
    begin, keeps_any = 0, False
    for i in range(len(marked) + 1):
        if i < len(marked) and marked[i]:
            continue
        if i - begin < fewest:
            for k in range(begin, i):
                marked[k] = False
        else:
            keeps_any = True
        begin = i + 1
    return keeps_any
