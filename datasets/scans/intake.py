"""The intake of raw scans: they are cleaned and counted, duplicates are dropped, and angle steps are checked."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from datasets.counts import ReadingCounts
from datasets.scans.cleaning import FATES, RangeRules, clean_ranges
from tbmslam.geometry.se2 import FloatArray
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.sensing.stretched_angles import round_step_deg

_MORE_THAN_A_TURN_DEG = 360.5
"""Angle from the first beam to the last; for some lasers both have the same direction."""
_LEAST_FAN = 30.0  # nearly five turns, or the smallest field of view of a laser in degrees


def are_degrees(beams: int, angle_increment: float) -> bool:
    """Return whether the stated step is in degrees instead of radians: as radians the beams span several turns."""
    return _LEAST_FAN <= abs(angle_increment) * (beams - 1) <= _MORE_THAN_A_TURN_DEG


def angle_warning(beams: int, angle_increment: float) -> str | None:
    """Return a warning if a stated angle step [rad] looks wrong, else None.

    Steps that may have been stretched (see `tbmslam.sensing.stretched_angles`) are not corrected here, since simulated
    lasers have such steps.
    """
    if beams < 2:
        return None
    if are_degrees(beams, angle_increment):
        turns = abs(angle_increment) * (beams - 1) / math.tau
        stated = f"the scans state {beams} beams {abs(angle_increment):g} rad apart, {turns:.0f} turns"
        return f"{stated}: their angles are read as degrees"
    step = abs(math.degrees(angle_increment))
    fan = step * (beams - 1)
    if fan > _MORE_THAN_A_TURN_DEG:
        return (
            f"the scans state {beams} beams {step:.4f} degrees apart, more than a turn: if these span one turn, pass "
            f"--angle-step-deg {360.0 / beams:.6g}"
        )
    true_step = round_step_deg(beams, angle_increment)
    if true_step is not None:
        return (
            f"the scans state {beams} beams {step:.4f} degrees apart; real lasers have steps of {true_step:g} "
            f"degrees: if yours has, pass --angle-step-deg {true_step:g}"
        )
    return None


_REMEMBERED_STAMPS = 64
_LARGEST_ANGLE = 4.0 * math.pi  # largest plausible angle of the first beam, or from the first to the last [rad]
_SMALLEST_FAN = 1e-3  # smallest field of view of a laser; a smaller angle has a wrong unit [rad]


class RawScan(NamedTuple):
    """A recorded scan: stamps in seconds, angles nominally in radians, ranges (N,) in metres."""

    stamp: float
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    ranges: npt.NDArray[np.floating]
    time_increment: float = 0.0

    def in_radians(self) -> "RawScan":
        """Return the scan with angles in radians if they were in degrees."""
        if not are_degrees(len(self.ranges), self.angle_increment):
            return self
        return self._replace(angle_min=math.radians(self.angle_min), angle_increment=math.radians(self.angle_increment))


class CleanScan(NamedTuple):
    """A scan with clean ranges."""

    ranges: FloatArray
    """A copy of the ranges (N,) as in `LaserScan` [m]."""
    range_min: float
    range_max: float
    farthest_m: float
    """Longest recorded range of a hit without offset [m]; 0 without hits."""
    says_nothing: bool
    """Whether all ranges are nan."""
    beams: list[int]
    """Numbers of beams by result, in the order of `FATES`."""


class ScanIntake:
    """Takes the scans of one pass in the order of the recording.

    `angle_step` replaces the recorded angle between beams [rad]. Pauses above `gap_s` are counted as gaps [s]. The
    stated time between beams is ignored if it makes a scan longer than `longest_sweep` [s].
    """

    def __init__(
        self,
        rules: RangeRules,
        angle_step: float | None,
        gap_s: float,
        counts: ReadingCounts,
        longest_sweep: float = math.inf,
    ) -> None:
        self._rules = rules
        self._angle_step = angle_step
        self._gap_s = gap_s
        self._counts = counts
        self._longest_sweep = longest_sweep
        self._last_stamp: float | None = None
        self._latest_stamp = -math.inf
        self._last_beams: int | None = None
        self._seen: OrderedDict[float, list[npt.NDArray[np.floating]]] = OrderedDict()

    def cleaned(self, scans: Sequence[RawScan]) -> list[CleanScan]:
        """Return scans with clean ranges, used or not: cleaning many at once takes far less time per scan."""
        groups: dict[tuple[int, float, float], list[int]] = {}
        for number, raw in enumerate(scans):
            groups.setdefault((len(raw.ranges), raw.range_min, raw.range_max), []).append(number)
        found: dict[int, CleanScan] = {}
        for (beams, range_min, range_max), numbers in groups.items():
            ranges = np.concatenate([scans[number].ranges for number in numbers]).reshape(len(numbers), beams)
            found.update(zip(numbers, self._cleaned_alike(ranges, range_min, range_max), strict=True))
        return [found[number] for number in range(len(scans))]

    def take(self, raw: RawScan, clean: CleanScan | None = None) -> LaserScan | None:
        """Return a recorded scan with clean ranges, or None, with the reason counted, if it cannot be used.

        `clean` is the result of `cleaned` for this scan, if it was computed before.
        """
        self._counts.scans_read += 1
        raw = raw.in_radians()
        if self._is_duplicate(raw):
            self._counts.drop("duplicate")
            return None
        self._watch(raw)
        step = self._angle_step if self._angle_step is not None else raw.angle_increment
        if not (math.isfinite(raw.angle_min) and math.isfinite(step) and step != 0.0):
            self._counts.drop("unreadable")
            return None
        fan = abs(step) * (len(raw.ranges) - 1)
        if abs(raw.angle_min) > _LARGEST_ANGLE or fan > _LARGEST_ANGLE or (len(raw.ranges) > 1 and fan < _SMALLEST_FAN):
            self._counts.drop("impossible_angles")
            return None
        clean = self.cleaned([raw])[0] if clean is None else clean
        for fate, number in zip(FATES, clean.beams, strict=True):
            self._counts.add_beams(fate, number)
        self._counts.any_finite = self._counts.any_finite or bool(np.isfinite(raw.ranges).any())
        if clean.farthest_m >= self._counts.farthest_m:
            self._counts.add_farthest(clean.farthest_m, raw.ranges)
        if clean.says_nothing:
            self._counts.drop("empty")
            return None
        return LaserScan(
            raw.stamp, raw.angle_min, step, clean.range_min, clean.range_max, clean.ranges, self._time_increment(raw)
        )

    def _cleaned_alike(self, ranges: npt.NDArray[np.floating], range_min: float, range_max: float) -> list[CleanScan]:
        """Return the clean ranges of scans (S, N) with the same stated limits [m]."""
        low, high = self._rules.limits(range_min, range_max)
        clean = clean_ranges(ranges, low, high, self._rules)
        farthest: list[float] = np.where(np.isfinite(clean.ranges), clean.ranges, 0.0).max(axis=1, initial=0.0).tolist()
        shifted, low, high = self._rules.shifted(clean.ranges, low, high)
        nothing = (
            np.count_nonzero(np.isnan(shifted), axis=1) == shifted.shape[1]
        ).tolist()  # true of no beams at all, too
        rows = zip(shifted, farthest, nothing, clean.beams.tolist(), strict=True)
        # A view would keep the rows of all scans in memory as long as one is held.
        return [CleanScan(row.copy(), low, high, top, empty, beams) for row, top, empty, beams in rows]

    def _time_increment(self, raw: RawScan) -> float:
        """Return the time between beams [s], 0 if it is not stated or cannot be."""
        if not 0.0 < raw.time_increment < math.inf:
            return 0.0
        if raw.time_increment * (len(raw.ranges) - 1) <= self._longest_sweep:
            return raw.time_increment
        self._counts.doubtful_sweeps += 1
        return 0.0

    def _is_duplicate(self, raw: RawScan) -> bool:
        """Return whether the same ranges came with the same stamp a short while ago."""
        known = self._seen.get(raw.stamp)
        if known is None:
            self._seen[raw.stamp] = [raw.ranges]
            if len(self._seen) > _REMEMBERED_STAMPS:
                self._seen.popitem(last=False)
            return False
        ranges = raw.ranges.tobytes()  # which are equal where nan is, too
        if any(each.tobytes() == ranges for each in known):
            return True
        self._counts.same_stamps += 1
        known.append(raw.ranges)
        return False

    def _watch(self, raw: RawScan) -> None:
        """Count steps of the clock and changes of the scan's size."""
        if self._last_stamp is not None:
            step = raw.stamp - self._last_stamp
            if step < 0.0:
                self._counts.backward_stamps += 1
                self._counts.incidents.add(raw.stamp, "the stamps of the scans step back")
            # Where a clock that stepped back is set right again, no time passes up to the latest stamp before.
            since = self._latest_stamp if raw.stamp >= self._latest_stamp else self._last_stamp
            if raw.stamp - since > self._gap_s:
                self._counts.add_gap(since, raw.stamp - since)
        self._counts.beam_count_changes += self._last_beams not in (None, len(raw.ranges))
        self._last_stamp, self._last_beams = raw.stamp, len(raw.ranges)
        self._latest_stamp = max(self._latest_stamp, raw.stamp)
