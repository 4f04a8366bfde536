"""A recording: a stream of readings that can be restarted, and its description."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias, TypeVar

from datasets.counts import ReadingCounts
from datasets.errors import DatasetError
from tbmslam.sensing.laser_scan import Reading

Item = TypeVar("Item")
_BLOCK = 256


def in_blocks(items: Iterable[Item]) -> Iterator[list[Item]]:
    """Yield items some at a time, those before a DatasetError, too."""
    block: list[Item] = []
    try:
        for item in items:
            block.append(item)
            if len(block) == _BLOCK:
                yield block
                block = []
    except DatasetError:
        yield block
        raise
    yield block


_REMEDIES = {
    "before_odometry": "check --odometry, --odom-frame and --clock-offset",
    "empty": "none of their beams holds a range; check --range-min and --range-max, or choose another --scan-topic",
    "unreadable": "pass --angle-step-deg if only the angle step is wrong, or choose another --scan-topic",
    "impossible_angles": "pass --angle-step-deg",
    "other_frame": "choose another --laser-frame or --scan-topic",
}
"""What to do where scans are dropped, by the reason."""

ReadingStream: TypeAlias = Callable[[ReadingCounts], Iterator[Reading]]


class Recording:
    """Readings in the order of the recording; every iteration streams them anew.

    Parameters
    ----------
    name
        Short name for people and files.
    stream
        Starts a pass: yields the readings and fills the counts it is given.
    description
        Everything that was chosen or found out, as JSON can hold it.
    expected_scans
        Upper bound of the number of readings, for progress bars; None if unknown.
    """

    def __init__(
        self, name: str, stream: ReadingStream, description: dict[str, object], expected_scans: int | None = None
    ) -> None:
        self.name = name
        self.description = description
        self.expected_scans = expected_scans
        self.counts = ReadingCounts()
        self._stream = stream

    def __iter__(self) -> Iterator[Reading]:
        """Yield the readings; `counts` holds this pass when it has come to its end.

        Raises
        ------
        DatasetError
            The recording is damaged, or none of its scans can be used.
        """
        counts = ReadingCounts()
        yield from self._stream(counts)
        self.counts = counts
        if counts.scans_used == 0:
            raise DatasetError(f"{self.name}: {_why_nothing(counts)}")


def _why_nothing(counts: ReadingCounts) -> str:
    """Return in one line why a pass gave no reading."""
    if counts.scans_read == 0:
        return "no scan in the recording: choose another with --scan-topic"
    reasons = ", ".join(f"{number} {reason}" for reason, number in sorted(counts.dropped.items()))
    main = max(counts.dropped, key=lambda reason: counts.dropped[reason], default="")
    remedy = _REMEDIES.get(main, "choose another --scan-topic")
    return f"none of {counts.scans_read} scans can be used ({reasons}): {remedy}"
