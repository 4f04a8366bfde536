"""A sound bag as rosbags opens it."""

import logging
import weakref
from collections.abc import Collection, Iterator
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosbags import rosbag1
from rosbags.interfaces import Connection

from datasets.salvaged_bag import BagConnection

if TYPE_CHECKING:
    from rosbags import rosbag2

logger = logging.getLogger(__name__)

_KEPT_CHUNKS = 6


class RawMessage(NamedTuple):
    """One message as it lies in the bag."""

    connection: BagConnection
    time: int
    data: bytes


class OpenBag:
    """A bag with its index in memory, which for a large one takes seconds to read.

    Its file is closed when nobody holds it any more, if not before.

    Parameters
    ----------
    path
        ROS 1 bag file; ROS 2 bag directory or storage file.
    is_ros1
        Which of them.

    Raises
    ------
    Exception
        Whatever rosbags raises where the bag is damaged.

    Attributes
    ----------
    connections
        Its topics.
    span
        Times of its first and its last message [ns].
    """

    def __init__(self, path: Path, is_ros1: bool) -> None:
        self._reader = _opened(path, is_ros1)
        self._finalizer = weakref.finalize(self, self._reader.close)
        if isinstance(self._reader, rosbag1.Reader):
            _keep_chunks(self._reader)
        self.connections = [_plain(connection) for connection in self._reader.connections]
        self.span = self._reader.start_time, self._reader.end_time

    def close(self) -> None:
        """Close the file, if it is not closed already."""
        self._finalizer()

    def messages(self, topics: Collection[str], steered_by: str) -> Iterator[RawMessage]:
        """Yield messages of some topics by time; a bag of ROS 1 by place where the times of `steered_by` step back.

        One pass at a time.
        """
        reader = self._reader
        connections = [connection for connection in reader.connections if connection.topic in topics]
        if not connections:  # rosbags takes none for all
            return
        if isinstance(reader, rosbag1.Reader) and _steps_back(reader, connections, steered_by):
            logger.info("%s: times of %s step back, read in the order of writing", reader.path, steered_by)
            yield from _in_order_of_writing(reader, connections)
        else:
            yield from _by_time(reader, connections)


def _opened(path: Path, is_ros1: bool) -> "rosbag1.Reader | rosbag2.Reader":
    if is_ros1:
        reader = rosbag1.Reader(path)
        reader.open()
        return reader
    from rosbags import rosbag2  # noqa: PLC0415 - slow to load, and a bag of ROS 1 does not need it

    newer = rosbag2.Reader(path)
    newer.open()
    return newer


def _plain(connection: Connection) -> BagConnection:
    """Return what is needed of a connection after its reader is closed."""
    return BagConnection(connection.id, connection.topic, connection.msgtype, connection.digest, connection.msgcount)


def _keep_chunks(reader: rosbag1.Reader) -> None:
    """Let a reader remember the last chunks it decompressed.

    Where topics lie in chunks of their own, reading by time jumps between these, and rosbags keeps only one.
    """
    remembered = {chunk.decompressor: lru_cache(_KEPT_CHUNKS)(chunk.decompressor) for chunk in reader.chunks.values()}
    reader.chunks = {
        place: chunk._replace(decompressor=remembered[chunk.decompressor]) for place, chunk in reader.chunks.items()
    }


def _by_time(reader: "rosbag1.Reader | rosbag2.Reader", connections: list[Connection]) -> Iterator[RawMessage]:
    plain = {connection.id: _plain(connection) for connection in connections}
    for connection, time, data in reader.messages(connections):
        yield RawMessage(plain[connection.id], time, data)


def _steps_back(reader: rosbag1.Reader, connections: list[Connection], steered_by: str) -> bool:
    """Return whether the messages of a topic were recorded in another order than that of their times."""
    return any(
        later < earlier
        for connection in connections
        if connection.topic == steered_by
        for earlier, later in pairwise(entry[1:] for entry in reader.indexes[connection.id])
    )


def _in_order_of_writing(reader: rosbag1.Reader, connections: list[Connection]) -> Iterator[RawMessage]:
    """Yield messages as they lie in the file.

    rosbags yields by time. Its index knows where each message lies: given as that of one topic, its order is kept.
    """
    plain = {connection.id: _plain(connection) for connection in connections}
    entries = [entry for connection in connections for entry in reader.indexes[connection.id]]
    own = reader.indexes
    reader.indexes = {**own, connections[0].id: sorted(entries, key=lambda entry: entry[1:])}
    try:
        for connection, time, data in reader.messages(connections[:1]):
            yield RawMessage(plain[connection.id], time, data)
    finally:
        reader.indexes = own
