"""Beams followed while a robot moves, to find those that something on it blocks."""

import math

import numpy as np

from tbmslam.kernels import BoolArray, FloatArray, kernel


@kernel
def follow_beams(
    state: FloatArray, ranges: FloatArray, here: tuple[float, ...], limits: tuple[float, ...], fewest: int
) -> tuple[BoolArray, BoolArray, bool, bool]:
    """Return which beams (B,) are blocked, which are suspected to be, and whether any is.

    Parameters
    ----------
    state
        (5, B): where a beam ended when it began to be constant [m], its stamp [s] and the way [m] then, longer by what
        the robot went since without a return, and the largest and the smallest turn at which it returned since [rad].
    ranges
        Where the beams (B,) end now [m].
    here
        The stamp [s], the way [m] and the turn [rad] by now, and the way since the last look [m].
    limits
        How far ranges of a constant beam differ; how near it ends; the way and the turn that it outlasts; how near is
        very near, and way and turn for that [m, rad].
    fewest
        Neighbours that must be blocked, or suspected, together.
    """
    stamp, way, turn, step = here
    spread, near, travelled, turned, very_near, soon, soon_turned = limits
    blocked, suspected = np.zeros(len(ranges), dtype=np.bool_), np.zeros(len(ranges), dtype=np.bool_)
    for i in range(len(ranges)):
        # What got lost proves nothing: a laser that sees near things alone meets some at one range by chance.
        if not math.isfinite(ranges[i]):
            state[2, i] += step
        else:
            if not abs(ranges[i] - state[0, i]) <= spread:  # what ends far off is not on the robot
                state[0, i], state[1, i], state[2, i] = ranges[i], stamp, way
                state[3, i] = state[4, i] = turn
            state[3, i], state[4, i] = max(state[3, i], turn), min(state[4, i], turn)
        if state[0, i] < near:
            length, angle = way - state[2, i], state[3, i] - state[4, i]
            suspected[i] = state[0, i] < very_near and length + angle > 0.0
            is_soon = suspected[i] and length >= soon and angle >= soon_turned
            blocked[i] = is_soon or (length >= travelled and angle >= turned)
    return blocked, suspected, _keep_runs(blocked, fewest), _keep_runs(suspected, fewest)


@kernel
def _keep_runs(marked: BoolArray, fewest: int) -> bool:
    """Drop the marks (B,) that have too few marked neighbours in a row; return whether there are others."""
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
