"""The readable messages of a damaged bag, and estimates of its losses."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import yaml

from tbmslam.special_file import why_unreadable

UNKNOWN_LOSS = "it is cut off, and the number of missing messages is unknown"
_KEPT_BLOCKS = 6


class BagConnection(NamedTuple):
    """The messages of a publisher of a topic."""

    id: int
    topic: str
    msgtype: str
    digest: str
    msgcount: int = 0
    is_ros1: bool = False
    """Whether its messages have the format of ROS 1, which an MCAP file may hold too."""


class Hole(NamedTuple):
    """A missing part: the number of messages before it in the order of writing, and its bytes of messages."""

    after: int
    size: int


class Loss(NamedTuple):
    """A lost part of a topic: estimated begin, duration [s] and number of messages."""

    since: float
    seconds: float
    messages: int


@dataclass(frozen=True)
class SalvagedBag:
    """The readable messages of a damaged bag."""

    path: Path
    reason: str
    """The damage."""
    connections: list[BagConnection]
    """All topics found."""
    entries: npt.NDArray[np.int64]
    """(N, 5) in the order of writing: time [ns], connection, block, place in the block and size [bytes]."""
    holes: tuple[Hole, ...]
    """The missing parts."""
    block: Callable[[int], bytes]
    """Function that returns a block's bytes by its number."""
    _kept: Callable[[int], bytes] = field(init=False, repr=False)

    @classmethod
    def of(
        cls,
        path: Path,
        reason: str,
        connections: Iterable[BagConnection],
        entries: npt.NDArray[np.int64],
        holes: Iterable[Hole],
        block: Callable[[int], bytes],
    ) -> "SalvagedBag":
        """Leave out the messages of unknown connections, and count those of each connection."""
        listed = list(connections)
        known = entries[np.isin(entries[:, 1], [connection.id for connection in listed])]
        counts = Counter(known[:, 1].tolist())
        counted = [connection._replace(msgcount=counts[connection.id]) for connection in listed]
        return cls(path, reason, counted, known, tuple(holes), block)

    def __post_init__(self) -> None:
        """Cache the last blocks: if topics are in different blocks, reading by time alternates between them."""
        object.__setattr__(self, "_kept", lru_cache(_KEPT_BLOCKS)(self.block))

    def messages(
        self, connections: Collection[BagConnection], *, by_time: bool
    ) -> Iterator[tuple[BagConnection, int, bytes]]:
        """Yield connection, time [ns] and bytes of messages, by time or in the order of writing."""
        wanted = {connection.id: connection for connection in connections}
        chosen = self.entries[np.isin(self.entries[:, 1], list(wanted))]
        if by_time:
            chosen = chosen[np.argsort(chosen[:, 0], kind="stable")]
        for time, connection, block, place, size in chosen.tolist():
            yield wanted[connection], time, bytes(self._kept(block)[place : place + size])

    def times(self, topic: str) -> npt.NDArray[np.int64]:
        """Return the times of recording of a topic's messages [ns] in the order of writing."""
        return np.asarray(self.entries[self._is_of(topic), 0])

    def losses(self, topic: str) -> list[Loss]:
        """Estimate the losses of a topic from the pauses at missing parts, and from the bytes missing at an end.

        A single message allows no estimate; then the loss has no messages.
        """
        places = np.flatnonzero(self._is_of(topic))
        times = self.entries[places, 0] * 1e-9
        if len(times) < 2:
            return [Loss(float(times[0]), 0.0, 0)] if len(times) and self.holes else []
        period = float(np.median(np.diff(times))) or 1e-3
        seconds_per_byte = period * len(times) / max(int(self.entries[:, 4].sum()), 1)
        missing: dict[int, float] = {}
        for hole in self.holes:
            after = int(np.searchsorted(places, hole.after))
            if 0 < after < len(times):
                missing[after] = float(times[after] - times[after - 1]) - period
            else:
                missing[after] = missing.get(after, 0.0) + hole.size * seconds_per_byte
        return [
            Loss(float(times[max(after - 1, 0)]), seconds, round(seconds / period))
            for after, seconds in sorted(missing.items())
            if round(seconds / period) > 0
        ]

    def _is_of(self, topic: str) -> npt.NDArray[np.bool_]:
        ids = [connection.id for connection in self.connections if connection.topic == topic]
        return np.asarray(np.isin(self.entries[:, 1], ids))


_LARGEST = 10_000_000  # largest description [bytes]


@dataclass(frozen=True)
class BagAnnouncement:
    """Files and messages by the description of a ROS 2 bag."""

    files: tuple[str, ...] = ()
    messages: dict[str, int] = field(default_factory=dict)
    """Number of messages of each topic."""
    start: float = 0.0
    seconds: float = 0.0
    """Begin and duration of the recording [s]."""

    def missing_files(self, folder: Path) -> list[str]:
        """Return the names of missing files."""
        return [name for name in self.files if not (folder / name).is_file()]

    def loss(self, topic: str, found: int) -> Loss | None:
        """Return the loss of a topic, given the number of its messages that are found or known to be lost."""
        announced = self.messages.get(topic, 0)
        if announced <= found:
            return None
        missing = announced - found
        return Loss(self.start, self.seconds * missing / announced, missing)


def announced_by(folder: Path) -> BagAnnouncement:
    """Read the description of a ROS 2 bag; if it cannot be read, the result is empty."""
    path = folder / "metadata.yaml"
    try:
        if why_unreadable(path) or path.stat().st_size > _LARGEST:
            return BagAnnouncement()
        information = yaml.safe_load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        files = tuple(Path(str(name)).name for name in information["relative_file_paths"])
        messages: dict[str, int] = {}
        for topic in information["topics_with_message_count"]:
            name = str(topic["topic_metadata"]["name"])
            messages[name] = messages.get(name, 0) + int(topic["message_count"])
        start = 1e-9 * int(information["starting_time"]["nanoseconds_since_epoch"])
        seconds = 1e-9 * int(information["duration"]["nanoseconds"])
    except Exception:  # noqa: BLE001 - a damaged description may hold anything
        return BagAnnouncement()
    return BagAnnouncement(files, messages, start, seconds)
