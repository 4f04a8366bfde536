"""Cleaning of ranges: hits, codes for no return, and unknown values."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from datasets.counts import is_like_a_code
from datasets.options import RecordingOptions
from tbmslam.geometry.se2 import FloatArray

# Codes of SICK, Hokuyo and their drivers for no return: 8183, 8187 .. 8191 cm, 65533 and 65535 mm.
KNOWN_CODES = (81.83, 81.87, 81.88, 81.89, 81.90, 81.91, 65.53, 65.533, 65.535)
CODE_TOLERANCE = 5e-4
FATES = ("nan", "no_return", "zero", "too_close", "hit")
"""Possible results of a beam."""
FARTHEST = 1000.0
"""Limit of all lasers of robots [m]: larger stated limits are ignored, and longer ranges are codes."""


@dataclass(frozen=True)
class RangeRules:
    """The rules of cleaning for a laser."""

    range_min: float | None
    range_max: float | None
    """Limits [m] that replace the limits of the scan; None keeps the limits of the scan."""
    no_return_codes: tuple[float, ...]
    """Ranges [m] that mean no return, also within the limits."""
    no_return: Literal["free", "drop"]
    """"free" turns such a beam into +inf, "drop" into nan."""
    offset: float = 0.0
    """Correction that is added to all measured ranges and to the limits [m]."""

    @classmethod
    def of(cls, options: RecordingOptions) -> "RangeRules":
        """Return the rules that the options state."""
        codes = (*KNOWN_CODES, *options.no_return_codes)
        return cls(options.range_min, options.range_max, codes, options.no_return, options.range_offset)

    def with_code_of(self, scans: Iterable[npt.NDArray[np.floating]], limit: float) -> "RangeRules":
        """Return the rules with a no-return code that is found in ranges (N,) of scans below a limit [m]."""
        found = find_no_return_code([scan[scan < limit] for scan in scans], self.no_return_codes)
        return self if found is None else replace(self, no_return_codes=(*self.no_return_codes, found))

    def shifted(self, ranges: FloatArray, low: float, high: float) -> tuple[FloatArray, float, float]:
        """Return clean ranges (S, N) and their limits [m] with the offset; ranges that become negative are nan."""
        if self.offset == 0.0:
            return ranges, low, high
        longer = ranges + self.offset
        longer[longer <= 0.0] = np.nan
        return longer, max(low + self.offset, 0.0), max(high + self.offset, 0.0)

    def limits(self, range_min: float, range_max: float) -> tuple[float, float]:
        """Return the limits for a scan that states these; contradicting limits are ignored."""
        contradictory = 0.0 < range_max <= range_min
        low, high = self.range_min, self.range_max
        if low is None:
            low = range_min if 0.0 <= range_min < math.inf and not contradictory else 0.0
        if high is None:
            high = range_max if low < range_max < FARTHEST and not contradictory else FARTHEST
        return float(low), float(high)


def limits_warning(range_min: float, range_max: float) -> str | None:
    """Return a warning if the stated limits of a scan [m] contradict each other, else None."""
    if not 0.0 < range_max <= range_min:
        return None
    stated = f"the scans state ranges from {range_min:g} to {range_max:g} m"
    return f"{stated}; these limits contradict each other and are ignored: pass --range-min and --range-max"


class CleanRanges(NamedTuple):
    """Clean ranges of scans, and the number of beams by result for each scan."""

    ranges: FloatArray
    """As in `LaserScan` (REP 117), (S, N) [m]: finite hits, +inf for nothing in range, nan for no information."""
    beams: npt.NDArray[np.intp]
    """Numbers of beams (S, 5) that met each of the `FATES`."""


def clean_ranges(ranges: npt.ArrayLike, range_min: float, range_max: float, rules: RangeRules) -> CleanRanges:
    """Convert raw ranges (S, N) of scans [m] to those of `LaserScan`, and count the beams by result.

    The limits are those of `RangeRules.limits` [m]. Many scans at once take hardly longer than a single scan.
    """
    cleaned = np.array(ranges, dtype=np.float64)
    no_return = _are_without_return(cleaned, range_max, rules.no_return_codes)
    beams = np.zeros((len(cleaned), len(FATES)), dtype=np.intp)
    beams[:, 0] = np.count_nonzero(np.isnan(cleaned), axis=1)
    beams[:, 1] = np.count_nonzero(no_return, axis=1)
    if (cleaned <= range_min).any():  # rarely true
        is_zero = (cleaned == 0.0) & ~no_return
        too_close = (cleaned < range_min) & ~is_zero & ~no_return  # REP 117: -inf is an object too close to measure
        cleaned[is_zero | too_close] = np.nan
        beams[:, 2] = np.count_nonzero(is_zero, axis=1)
        beams[:, 3] = np.count_nonzero(too_close, axis=1)
    cleaned[no_return] = np.inf if rules.no_return == "free" else np.nan
    beams[:, 4] = np.count_nonzero(np.isfinite(cleaned), axis=1)
    return CleanRanges(cleaned, beams)


def _are_without_return(ranges: FloatArray, range_max: float, codes: Iterable[float]) -> npt.NDArray[np.bool_]:
    """Return which ranges (S, N) [m] mean no return."""
    no_return = np.asarray(ranges >= range_max)  # +inf, too
    below = [code for code in codes if code - CODE_TOLERANCE < range_max]
    if below:
        # Few ranges are as long as a code, so only these are compared with each code.
        long = ranges > min(below) - 2.0 * CODE_TOLERANCE
        if long.any():
            no_return[long] |= (np.abs(ranges[long][:, None] - np.array(below)) < CODE_TOLERANCE).any(axis=1)
    return no_return


def find_no_return_code(scans: Iterable[npt.ArrayLike], known: Iterable[float] = ()) -> float | None:
    """Return a code for no return that is not yet known, from the ranges of some scans below the limit [m].

    Such a code is the largest of all values, exact, measured by several beams of a scan, and far more frequent than the
    values next to it.
    """
    arrays = [np.asarray(scan, dtype=np.float64) for scan in scans]
    values = [scan[np.isfinite(scan) & (scan > 0.0)] for scan in arrays]
    for code in known:
        values = [scan[np.abs(scan - code) >= CODE_TOLERANCE] for scan in values]
    if not sum(map(len, values)):
        return None
    distinct, numbers = np.unique(np.concatenate(values), return_counts=True)
    top, number = distinct[-1], int(numbers[-1])
    holding = sum(bool((scan == top).any()) for scan in values)
    beside = numbers[:-1][distinct[:-1] > 0.9 * top]
    usual = float(beside.mean()) if len(beside) else 1.0
    is_code = is_like_a_code(float(top), int(number), holding, int(numbers.sum()))
    return float(top) if is_code and number >= 10.0 * usual else None
