"""Incidents of a drive with their times, for warnings."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

_MOST_KEPT = 100
SOON_S = 5.0
"""Events with a smaller distance in time are one incident [s]."""


class Incident(NamedTuple):
    """One incident."""

    stamp: float
    """When it began [s]."""
    what: str
    """What happened, as text after "at 12.3 s: "."""
    seconds: float = 0.0
    """How long it lasted [s]; 0 for a moment."""
    all_along: bool = False
    """Whether it holds for the whole drive."""

    def text(self, start: float) -> str:
        """Return one line, with the time since the start of the drive if it has one."""
        if self.all_along:
            return self.what
        lasting = f", for {self.seconds:.1f} s" if self.seconds else ""
        fact, colon, remedy = self.what.partition(": ")
        return f"at {self.stamp - start:.1f} s: {fact}{lasting}{colon}{remedy}"

    def as_dict(self, start: float) -> dict[str, object]:
        """Return it as JSON can hold it."""
        return {
            "at_s": round(self.stamp - start, 3),
            "stamp": self.stamp,
            "what": self.what,
            "seconds": self.seconds,
            "all_along": self.all_along,
        }


def in_order(incidents: Iterable[Incident]) -> list[Incident]:
    """Return incidents of the whole drive, then the others by time."""
    return sorted(incidents, key=lambda incident: (not incident.all_along, incident.stamp))


@dataclass
class Incidents:
    """Incidents in the order in which they were found; after the first hundred they are only counted."""

    _kept: list[Incident] = field(default_factory=list)
    _found: int = 0
    _concluded: list[Incident] = field(default_factory=list)

    def __iter__(self) -> Iterator[Incident]:
        """Yield up to a hundred incidents, see `in_order`; those of the whole drive are kept before all others."""
        whole = [incident for incident in self._concluded if incident.all_along]
        others = [incident for incident in self._concluded if not incident.all_along]
        return iter(in_order([*whole, *self._kept, *others][:_MOST_KEPT]))

    def __len__(self) -> int:
        """Return the number of incidents that are yielded."""
        return min(len(self._kept) + len(self._concluded), _MOST_KEPT)

    @property
    def number(self) -> int:
        """Number of all incidents."""
        return self._found + len(self._concluded)

    def add(self, stamp: float, what: str, seconds: float = 0.0) -> int:
        """Add an incident and return its number; the continuation of an earlier incident extends that one."""
        for number in range(len(self._kept) - 1, max(len(self._kept) - 4, -1), -1):
            known = self._kept[number]
            if known.what == what and 0.0 <= stamp - known.stamp - known.seconds <= SOON_S:
                self.lengthen(number, stamp + seconds)
                return number
        if len(self._kept) < _MOST_KEPT:
            self._kept.append(Incident(stamp, what, seconds))
        self._found += 1
        return self._found - 1

    def conclude(self, stamp: float, what: str, seconds: float, *, all_along: bool = False) -> None:
        """Add an incident at the end of a drive, until the drive continues (see `reopen`)."""
        self._concluded.append(Incident(stamp, what, seconds, all_along))

    def reopen(self) -> None:
        """Remove the incidents of the end of the drive, because the drive continues or ends again."""
        self._concluded.clear()

    def lengthen(self, number: int, stamp: float) -> None:
        """Extend an incident to a stamp [s]."""
        if number < len(self._kept):
            known = self._kept[number]
            self._kept[number] = known._replace(seconds=max(known.seconds, stamp - known.stamp))

    def reword(self, number: int, what: str) -> None:
        """Change the text of an incident."""
        if number < len(self._kept):
            self._kept[number] = self._kept[number]._replace(what=what)


class EndWarning(NamedTuple):
    """A warning at the end of a drive."""

    subject: str
    """Its subject."""
    what: str
    """The fact and the remedy."""
    stamp: float = 0.0
    seconds: float = 0.0
    """When it began and how long it lasted [s]."""
    all_along: bool = True
