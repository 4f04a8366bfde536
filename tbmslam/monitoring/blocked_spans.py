"""Which beams were blocked when: to clear earlier scans once it is known, and to tell people."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.laser_scan import LaserScan
from tbmslam.se2 import FloatArray

_Beams = npt.NDArray[np.bool_]
_MOST_TOLD = 3


class _Span(NamedTuple):
    begin: float
    until: float
    beams: npt.NDArray[np.int64]
    farthest: FloatArray


class BlockedSpans:
    """Stretches of time in which beams were blocked."""

    def __init__(self) -> None:
        self._ended: list[_Span] = []

    def end(self, beams: _Beams, since: FloatArray, farthest: FloatArray, stamp: float) -> None:
        """Note that beams (B,) are no longer blocked at a stamp [s].

        Parameters
        ----------
        since
            Stamps (B,) since when they were [s].
        farthest
            How far they ended at the most (B,) [m]: what went farther saw something else.
        """
        self._ended += _spans(beams, since, farthest, stamp)

    def were_any(self) -> bool:
        """Tell whether beams were blocked that no longer are."""
        return bool(self._ended)

    def cleared(self, scan: LaserScan, beams: _Beams, since: FloatArray, farthest: FloatArray) -> LaserScan:
        """Return a scan without the beams that were blocked at its time; those given (B,) still are, as in `end`."""
        hidden = np.zeros(len(scan.ranges), dtype=np.bool_)
        for span in [*self._ended, *_spans(beams, since, farthest, math.inf)]:
            if span.begin <= scan.stamp < span.until and span.beams.max() < len(hidden):
                hidden[span.beams] |= scan.ranges[span.beams] <= span.farthest
        return scan.with_ranges(np.where(hidden, np.nan, scan.ranges)) if hidden.any() else scan


def _spans(beams: _Beams, since: FloatArray, farthest: FloatArray, until: float) -> list[_Span]:
    """Return when beams (B,) began to be blocked, when they ended, and which ones."""
    groups = [(float(stamp), np.flatnonzero(beams & (since == stamp))) for stamp in np.unique(since[beams])]
    return [_Span(stamp, until, group, farthest[group]) for stamp, group in groups]


def directions(scan: LaserScan, beams: _Beams) -> str:
    """Return where beams (B,) point to, for people; those a few degrees apart are together."""
    angles = np.degrees(scan.angle_min + scan.angle_increment * np.flatnonzero(beams))
    parts = np.split(angles, np.flatnonzero(np.abs(np.diff(angles)) > 5.0) + 1)
    said = ", ".join(f"{part[0]:.0f} to {part[-1]:.0f}" for part in parts[:_MOST_TOLD])
    return f"{said}°" + (f" and {len(parts) - _MOST_TOLD} more" if len(parts) > _MOST_TOLD else "")
