"""Which beams were blocked when: to clear earlier scans once it is known, and to tell people."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray
from tbmslam.sensing.laser_scan import LaserScan

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
        self._latest: dict[tuple[bytes, bytes], int] = {}  # the last span of the same beams, as near
        self._timetable: _Timetable | None = None  # of those ended, made when it is asked for

    def __len__(self) -> int:
        """Return the number of spans that ended; those of the same beams that overlap or abut are one."""
        return len(self._ended)

    def end(self, beams: _Beams, since: FloatArray, farthest: FloatArray, stamp: float) -> None:
        """Note that beams (B,) are no longer blocked at a stamp [s].

        Parameters
        ----------
        since
            Stamps (B,) since when they were [s].
        farthest
            How far they ended at the most (B,) [m]: what went farther saw something else.
        """
        for span in _spans(beams, since, farthest, stamp):
            self._timetable = None
            same = span.beams.tobytes(), span.farthest.tobytes()
            number = self._latest.get(same, -1)
            last = self._ended[number] if number >= 0 else None
            if last is not None and span.begin <= last.until and last.begin <= span.until:
                both = last._replace(begin=min(last.begin, span.begin), until=max(last.until, span.until))
                self._ended[number] = both
            else:
                self._latest[same] = len(self._ended)
                self._ended.append(span)

    def were_any(self) -> bool:
        """Tell whether beams were blocked that no longer are."""
        return bool(self._ended)

    def cleared(self, scan: LaserScan, beams: _Beams, since: FloatArray, farthest: FloatArray) -> LaserScan:
        """Return a scan without the beams that were blocked at its time; those given (B,) still are, as in `end`."""
        hidden = np.zeros(len(scan.ranges), dtype=np.bool_)
        if self._timetable is None:
            self._timetable = _Timetable(self._ended)
        still = (span for span in _spans(beams, since, farthest, math.inf) if span.begin <= scan.stamp)
        for span in (*self._timetable.at(scan.stamp), *still):
            if span.beams[-1] < len(hidden):  # they rise
                hidden[span.beams] |= scan.ranges[span.beams] <= span.farthest
        return scan.with_ranges(np.where(hidden, np.nan, scan.ranges)) if hidden.any() else scan


class _Timetable:
    """Spans in the order in which they ended, to find those of a moment among a day's.

    Parameters
    ----------
    spans
        The spans, in any order.
    """

    def __init__(self, spans: Sequence[_Span]) -> None:
        self._spans = sorted(spans, key=lambda span: span.until)
        self._untils = np.array([span.until for span in self._spans], dtype=np.float64)
        self._begins = np.array([span.begin for span in self._spans], dtype=np.float64)
        # When the first of each and all later ones began.
        self._earliest = np.minimum.accumulate(self._begins[::-1])[::-1]

    def at(self, stamp: float) -> list[_Span]:
        """Return those that had begun at a stamp [s], but not ended."""
        first = int(np.searchsorted(self._untils, stamp, side="right"))
        last = int(np.searchsorted(self._earliest, stamp, side="right"))
        begun = np.flatnonzero(self._begins[first:last] <= stamp)
        return [self._spans[first + number] for number in begun.tolist()]


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
