"""Counts of the scans and beams of a recording."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.monitoring.incidents import Incident, Incidents

_CODE_BEAMS, _CODE_SHARE, _CODE_SCANS, _CODE_WIDTH, _CODE_NEAREST = 20, 0.005, 5, 3, 3.0
"""A code for no return: least number of beams, share of all, scans, beams per scan, and its length [m]."""


SCANS, _ARE = ("scan", "scans"), ("scan is", "scans are")


def is_like_a_code(range_m: float, beams: int, scans: int, all_beams: int) -> bool:
    """Return whether a range may mean "no return", because many beams of all scans have exactly this range."""
    is_frequent = beams >= max(_CODE_BEAMS, _CODE_SHARE * all_beams)
    is_wide = scans >= _CODE_SCANS and beams >= _CODE_WIDTH * scans
    return is_frequent and is_wide and range_m > _CODE_NEAREST


class Span(NamedTuple):
    """A part of a recording, from its first scan to its last."""

    first: float
    """Stamp [s]."""
    last: float
    """Stamp [s]."""

    def meets(self, stamp: float, seconds: float) -> bool:
        """Return whether an event overlaps the span; it begins at a stamp and has a duration, which may be 0."""
        if seconds == 0.0:
            return self.first <= stamp <= self.last
        return stamp < self.last and stamp + seconds > self.first


def in_number(number: int, one: str, many: str) -> str:
    """Return a number and what it counts, as in "1 scan is lost" and "2 scans are lost"."""
    return f"{number} {one if number == 1 else many}"


def gaps_in_words(lengths: list[float]) -> str:
    """Return the number and the lengths of gaps as text; `lengths` (N,), one or more [s]."""
    if len(lengths) == 1:
        return f"1 gap of {lengths[0]:.1f} s without a scan"
    return f"{len(lengths)} gaps of {sum(lengths):.1f} s in all without a scan, the longest {max(lengths):.1f} s"


@dataclass
class ReadingCounts:
    """Counts of one pass over a recording."""

    scans_read: int = 0
    scans_used: int = 0
    """Scans in the recording, and those that became readings."""
    dropped: dict[str, int] = field(default_factory=dict)
    """Scans left out, by reason: before_odometry, empty, duplicate, unreadable, impossible_angles, other_frame (another
    laser on the same topic)."""
    beams: dict[str, int] = field(default_factory=dict)
    """Beams of scans with possible angles, except duplicates, by result: hit, no_return, too_close, zero, nan."""
    backward_stamps: int = 0
    """Scans, used or not, whose stamp is earlier than that of the scan before."""
    same_stamps: int = 0
    """Scans with the stamp of an earlier scan but other ranges; they are kept."""
    beam_count_changes: int = 0
    """Number of changes of the number of beams between consecutive scans."""
    gaps: int = 0
    gap_seconds: float = 0.0
    longest_gap_s: float = 0.0
    """Pauses between scans, their sum and the longest [s]."""
    extrapolated: int = 0
    """Used scans whose odometry was extrapolated: shortly after the last pose, or at the edge of a long gap."""
    without_odometry: int = 0
    """Used scans without odometry: farther within such a gap, or longer after the last pose."""
    clock_disagreements: int = 0
    """Scans whose stamps stepped relative to the bag's clock, which is used for them."""
    lost_scans: int = 0
    lost_seconds: float = 0.0
    """Estimated loss by damage of the file."""
    incidents: Incidents = field(default_factory=Incidents)
    doubtful_sweeps: int = 0
    """Scans with an impossible time between beams; their beams are taken as simultaneous."""
    farthest_m: float = 0.0
    farthest_beams: int = 0
    farthest_scans: int = 0
    """The longest range of a hit [m], the number of beams with exactly this range, and the number of their scans."""
    pauses: list[tuple[float, float]] = field(default_factory=list)
    """Stamp of the scan before each gap, and length of the gap [s]."""

    any_finite: bool = False
    """Whether any recorded range of these beams is finite, within the limits or not."""

    def drop(self, reason: str) -> None:
        """Count a scan that is left out."""
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def add_beams(self, fate: str, number: int) -> None:
        """Count beams by result."""
        if number:
            self.beams[fate] = self.beams.get(fate, 0) + number

    def add_farthest(self, top: float, ranges: npt.NDArray[np.floating]) -> None:
        """Count the beams of a scan, ranges (N,) [m], with the longest range `top` of a hit [m]; 0 if none is a hit."""
        if top < self.farthest_m or top == 0.0:
            return
        if top > self.farthest_m:
            self.farthest_m, self.farthest_beams, self.farthest_scans = top, 0, 0
        self.farthest_beams += int(np.count_nonzero(ranges == top))
        self.farthest_scans += 1

    def likely_code(self) -> float | None:
        """Return the range that counted as a hit but may be a code for no return [m].

        A code is the longest range, and several beams of a scan, and many of the recording, have exactly this range.
        The same rule applies at the beginning of a recording, when the code may not have occurred yet.
        """
        is_code = is_like_a_code(self.farthest_m, self.farthest_beams, self.farthest_scans, self.beams.get("hit", 0))
        return self.farthest_m if is_code else None

    def add_gap(self, stamp: float, seconds: float) -> None:
        """Count a gap after the scan with a stamp [s]."""
        self.incidents.add(stamp, "no scans", seconds)
        self.pauses.append((stamp, seconds))
        self.gaps += 1
        self.gap_seconds += seconds
        self.longest_gap_s = max(self.longest_gap_s, seconds)

    def incidents_in(self, span: Span | None) -> list[Incident]:
        """Return the incidents in a part of the recording; None for the whole recording."""
        return [incident for incident in self.incidents if span is None or span.meets(incident.stamp, incident.seconds)]

    def pauses_in(self, span: Span | None) -> list[float]:
        """Return the lengths of the gaps in a part of the recording [s]; None for the whole recording."""
        return [seconds for stamp, seconds in self.pauses if span is None or span.meets(stamp, seconds)]

    def replace_by(self, other: "ReadingCounts") -> None:
        """Replace all counts by those of another pass."""
        for name, value in vars(other).items():
            setattr(self, name, dict(value) if isinstance(value, dict) else value)

    def as_dict(self) -> dict[str, object]:
        """Return all counts for JSON in a fixed order, without incidents, pauses and flags."""
        return {
            name: dict(sorted(value.items())) if isinstance(value, dict) else value
            for name, value in vars(self).items()
            if name not in ("incidents", "pauses", "any_finite")
        }

    def anomalies(self) -> list[str]:
        """Return a sentence for each kind of anomaly that occurred, except gaps and dropped scans."""
        sentences = [
            f"{in_number(number, *words)} {what}"
            for number, words, what in (
                (self.backward_stamps, _ARE, "stamped earlier than the scan before: the clock stepped back"),
                (self.same_stamps, ("scan has", "scans have"), "the stamp of an earlier scan"),
                (self.clock_disagreements, _ARE, "stamped by another clock than the rest of the recording"),
                (self.extrapolated, _ARE, "beyond the odometry, at its end or at a long gap: it was extrapolated"),
                (self.without_odometry, SCANS, "had no odometry, so scan matching alone estimated the motion"),
                (self.doubtful_sweeps, ("scan states", "scans state"), "an impossible time between beams"),
            )
            if number
        ]
        if (code := self.likely_code()) is not None:
            sentences.append(
                f"{in_number(self.farthest_beams, 'beam ends', 'beams end')} at exactly {code:.6g} m, the longest "
                f"range of all, which may be a code for no return: try --no-return-code {code:.6g}"
            )
        if self.beam_count_changes:
            sentences.append(f"the number of beams changed {in_number(self.beam_count_changes, 'time', 'times')}")
        if self.lost_scans:
            lost = in_number(self.lost_scans, *SCANS)
            sentences.append(f"about {lost}, {self.lost_seconds:.1f} s, lost in a damaged file")
        return sentences

    def summary(self) -> str:
        """Return one or two lines of text: used scans, dropped scans with reasons, and anomalies."""
        lines = [f"{self.scans_used} of {in_number(self.scans_read, *SCANS)} used"]
        if self.dropped:
            lines[0] += ", dropped: " + ", ".join(f"{n} {reason}" for reason, n in sorted(self.dropped.items()))
        total = sum(self.beams.values())
        if total:
            shares = (f"{100.0 * n / total:.1f} % {fate}" for fate, n in sorted(self.beams.items()))
            lines[0] += "; beams: " + ", ".join(shares)
        oddities = self.anomalies()
        if self.gaps:
            oddities.append(gaps_in_words(self.pauses_in(None)))
        if oddities:
            lines.append("odd: " + "; ".join(oddities))
        return "\n".join(lines)
