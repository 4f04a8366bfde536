"""What went wrong during a drive, and when: for warnings that name a time."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

_MOST_KEPT = 100
SOON_S = 5.0
"""What goes on after less than this is one incident [s]."""


class Incident(NamedTuple):
    """One thing that went wrong.

    Parameters
    ----------
    stamp
        When it began [s].
    what
        What happened, in words that go after "at 12.3 s: ".
    seconds
        How long it lasted [s]; 0 for a moment.
    all_along
        Whether it holds for the whole drive.
    """

    stamp: float
    what: str
    seconds: float = 0.0
    all_along: bool = False

    def text(self, start: float) -> str:
        """Return one line, with the time since the start of the drive where it has one."""
        if self.all_along:
            return self.what
        lasting = f", for {self.seconds:.1f} s" if self.seconds else ""
        fact, colon, remedy = self.what.partition(": ")
        return f"at {self.stamp - start:.1f} s: {fact}{lasting}{colon}{remedy}"

    def as_dict(self, start: float) -> dict[str, object]:
        """Return the same for JSON."""
        return {
            "at_s": round(self.stamp - start, 3),
            "stamp": self.stamp,
            "what": self.what,
            "seconds": self.seconds,
            "all_along": self.all_along,
        }


def in_order(incidents: Iterable[Incident]) -> list[Incident]:
    """Return incidents by time, those before all others that hold for a whole drive."""
    return sorted(incidents, key=lambda incident: (not incident.all_along, incident.stamp))


@dataclass
class Incidents:
    """Incidents as they are found; after the first hundred they are only counted."""

    _kept: list[Incident] = field(default_factory=list)
    number: int = 0
    _concluded: list[Incident] = field(default_factory=list)

    def __iter__(self) -> Iterator[Incident]:
        """Yield those that were kept, see `in_order`."""
        return iter(in_order(self._kept))

    def __len__(self) -> int:
        """Return the number of those that were kept."""
        return len(self._kept)

    def add(self, stamp: float, what: str, seconds: float = 0.0) -> int:
        """Note an incident and return its number; one that goes on soon after lasts longer instead."""
        for number in range(len(self._kept) - 1, max(len(self._kept) - 4, -1), -1):
            known = self._kept[number]
            if known.what == what and 0.0 <= stamp - known.stamp - known.seconds <= SOON_S:
                self.lengthen(number, stamp + seconds)
                return number
        self.number += 1
        if len(self._kept) < _MOST_KEPT:
            self._kept.append(Incident(stamp, what, seconds))
        return self.number - 1

    def conclude(self, stamp: float, what: str, seconds: float, *, all_along: bool = False) -> None:
        """Note what only the end of a drive tells, until it goes on (see `reopen`).

        What holds `all_along` is kept however much else there is.
        """
        incident = Incident(stamp, what, seconds, all_along)
        self.number += 1
        self._kept.insert(0 if all_along else len(self._kept), incident)
        del self._kept[_MOST_KEPT:]
        self._concluded.append(incident)

    def reopen(self) -> None:
        """Take back what the end of the drive told, as it goes on or ends anew."""
        for incident in self._concluded:
            self.number -= 1
            if incident in self._kept:
                self._kept.remove(incident)
        self._concluded.clear()

    def lengthen(self, number: int, stamp: float) -> None:
        """Let an incident last until a stamp [s]."""
        if number < len(self._kept):
            known = self._kept[number]
            self._kept[number] = known._replace(seconds=max(known.seconds, stamp - known.stamp))

    def reword(self, number: int, what: str) -> None:
        """Say otherwise what an incident was, as more is known of it."""
        if number < len(self._kept):
            self._kept[number] = self._kept[number]._replace(what=what)


class EndWarning(NamedTuple):
    """A warning that the end of a drive tells.

    Parameters
    ----------
    subject
        What it is about, in a word.
    what
        What is wrong, and what mends it.
    stamp, seconds
        When it began and how long it lasted [s].
    all_along
        Whether it holds for the whole drive.
    """

    subject: str
    what: str
    stamp: float = 0.0
    seconds: float = 0.0
    all_along: bool = True
