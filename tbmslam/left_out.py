"""What to say of a part of a drive that is not in the map, so that it can become one of its own."""

import math

import numpy as np

from tbmslam.se2 import FloatArray

_STEP_S = 0.01
"""Intervals are told in steps of it."""
_ASTRAY = 0.02
"""Readings by which an interval may differ from a part, as share of the part's: stamps may shake."""


def left_out_said(stamps: FloatArray, begin: int, end: int, started: float) -> str:
    """Return how to make a robot of a part that was left out: by `--interval`, unless no interval of time names it.

    Parameters
    ----------
    stamps
        Times (N,) of all readings of the drive [s]; they may step back.
    begin, end
        The part: its first reading, and the one after its last.
    started
        Stamp from which times are told [s].
    """
    since = stamps - started
    first = round(math.floor(since[begin] / _STEP_S) * _STEP_S, 2)
    last = round((math.floor(since[end - 1] / _STEP_S) + 1) * _STEP_S, 2)
    # As `tbmslam.segmentation.split_at_intervals` takes it: all from the first reading inside to the last one.
    inside = np.flatnonzero((since >= first) & (since < last))
    astray = abs(int(inside[0]) - begin) + abs(int(inside[-1]) + 1 - end) if len(inside) else math.inf
    if astray <= max(_ASTRAY * (end - begin), 1.0):
        return f"left out of the map, make a robot of it by --interval {first:.2f} {last:.2f}"
    return (
        f"left out of the map, and as the clock steps back no --interval names it: write its {end - begin} scans "
        "into a file of their own, and map that"
    )
