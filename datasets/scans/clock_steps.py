"""A scanner whose clock is set while it runs: its stamps jump although the recorder's clock goes on."""

from datasets.counts import ReadingCounts

_STEP_S = 1.0
_REGULAR_S = 0.5


class ClockSteps:
    """Follows the stamps of the scans beside the bag's own time, and takes steps out of them.

    Parameters
    ----------
    steady_lag
        Usual bag time minus stamp [s]; None where it varies too much to tell a step.
    counts
        Gets the steps.
    """

    def __init__(self, steady_lag: float | None, counts: ReadingCounts) -> None:
        self._steady_lag = steady_lag
        self._counts = counts
        self._last: tuple[float, float] | None = None
        self._is_off = False

    def corrected(self, stamp: float, bag_time: float) -> float:
        """Return a scan's stamp [s] by the clock that it had at first.

        A step is one of the stamps alone: where bag times jump, the recorder was busy, and the stamps are right.
        """
        last, self._last = self._last, (stamp, bag_time)
        if self._steady_lag is None:
            return stamp
        off = bag_time - stamp - self._steady_lag
        if abs(off) <= _STEP_S:
            self._is_off = False
            return stamp
        self._counts.clock_disagreements += 1
        if last is not None:
            passed = bag_time - last[1]
            stepped = abs(stamp - last[0] - passed) > _STEP_S and 0.0 <= passed < _REGULAR_S
            self._is_off = self._is_off or stepped
        if not self._is_off:
            return stamp
        corrected = bag_time - self._steady_lag
        self._counts.incidents.add(corrected, "the clock of the scans is set wrong, corrected by the recorder's")
        return corrected
