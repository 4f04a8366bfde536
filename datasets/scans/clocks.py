"""Comparison and correction of the clocks of scans and odometry."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from datasets.counts import ReadingCounts

# A scan with a correct stamp may arrive seconds later. A fault of a clock is longer and constant.
LATENCY_LIMIT_S = 5.0
STEADY_WITHIN_S = 0.5
_FEWEST = 5


class ClockFinding(NamedTuple):
    """Result of comparing two clocks."""

    offset: float
    """Difference between the clocks, to be added to stamps of scans [s]."""
    steady_lag: float | None
    """Usual bag time minus stamp of the scans [s]; None if it varies too much."""
    warning: str | None
    """A warning about an error or a correction."""


def lags_of_unset(scan_lags: Sequence[float], odometry_lags: Sequence[float]) -> tuple[float, float]:
    """Return bag time minus stamp of scans and of odometry, with estimates for unset stamps [s].

    The arguments are those of the first messages with a stamp. The clock of a simulation is zero at first, and then far
    from the recorder's. If neither has a stamp, the bag's clock is used.
    """
    scan_lag, odometry_lag = (float(np.median(lags)) if len(lags) else None for lags in (scan_lags, odometry_lags))
    either = next((lag for lag in (scan_lag, odometry_lag) if lag is not None), 0.0)
    return (either if scan_lag is None else scan_lag, either if odometry_lag is None else odometry_lag)


def compare_clocks(scan_lags: Sequence[float], odometry_lags: Sequence[float], delay: float = 0.0) -> ClockFinding:
    """Find a constant difference between the stamps of scans and of odometry from their lags, bag time minus stamp [s].

    `delay` is the known delay from the first beam of a scan to its recording, which is no fault of a clock [s].
    """
    if len(scan_lags) < _FEWEST:
        return ClockFinding(0.0, None, None)
    low, scan_lag, high = np.percentile(scan_lags, (10, 50, 90))
    scan_steady = high - low < STEADY_WITHIN_S
    steady_lag = float(scan_lag) if scan_steady else None
    if len(odometry_lags) < _FEWEST:
        return ClockFinding(0.0, steady_lag, None)
    odometry_low, odometry_lag, odometry_high = np.percentile(odometry_lags, (10, 50, 90))
    offset = float(scan_lag - delay - odometry_lag)
    if abs(offset) < 1.0:
        return ClockFinding(0.0, steady_lag, None)
    apart = f"lag {offset:.2f} s behind" if offset > 0.0 else f"are {-offset:.2f} s ahead of"
    fact = f"stamps of the scans {apart} those of the odometry"
    if abs(offset) < LATENCY_LIMIT_S:
        return ClockFinding(
            0.0, steady_lag, f"{fact}; this is treated as latency: pass --clock-offset if a clock is wrong"
        )
    if scan_steady and odometry_high - odometry_low < STEADY_WITHIN_S:
        return ClockFinding(offset, steady_lag, f"{fact}: a clock fault, corrected (--clock-offset 0 to leave it)")
    return ClockFinding(0.0, steady_lag, f"{fact}, but the offset varies, and was not corrected: pass --clock-offset")


_STEP_S = 1.0
_REGULAR_S = 0.5
_FOLLOWED, _MOST_FOLLOWED_S = 0.05, 0.005
"""Share of the lag's change that is followed with each scan, and its limit [s]: drift is followed, and no late scan."""


class ClockSteps:
    """Compares the stamps of the scans with the bag's time, removes steps, and counts the scans that were corrected.

    `steady_lag` is the usual bag time minus stamp [s]; None if it varies too much for the detection of steps. A steady
    drift of one clock, as of a simulation that is slower than the recorder, is no step, and is followed by up to 5 ms
    per scan. Faster drift, as of a simulation at half speed, soon takes the clocks 1 s apart. Then the recorder's clock
    is no measure for that of the scans, and steps are no longer removed.
    """

    def __init__(self, steady_lag: float | None, counts: ReadingCounts) -> None:
        self._lag = steady_lag
        self._counts = counts
        self._last: tuple[float, float] | None = None
        self._is_off = self._has_jumped = False

    def corrected(self, stamp: float, bag_time: float) -> float:
        """Return a scan's stamp by the initial clock [s].

        Only a step of the stamps without one of the bag times counts: after a jump of the bag times, the recorder was
        busy, and the stamps are right.
        """
        last, self._last = self._last, (stamp, bag_time)
        if self._lag is None:
            return stamp
        off = bag_time - stamp - self._lag
        if abs(off) <= _STEP_S:
            self._is_off = self._has_jumped = False
            self._lag += max(-_MOST_FOLLOWED_S, min(_FOLLOWED * off, _MOST_FOLLOWED_S))
            return stamp
        passed = bag_time - last[1] if last is not None else math.inf
        if last is None or abs(stamp - last[0] - passed) > _STEP_S:
            self._has_jumped = True
            self._is_off = self._is_off or 0.0 <= passed < _REGULAR_S
        if not self._has_jumped:  # the clocks drifted apart
            self._lag = None
        if self._lag is None or not self._is_off:
            return stamp
        self._counts.clock_disagreements += 1
        corrected = bag_time - self._lag
        self._counts.incidents.add(corrected, "the clock of the scans is wrong; the recorder's clock is used")
        return corrected
