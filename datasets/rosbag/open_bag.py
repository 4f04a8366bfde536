"""A sound bag as rosbags opens it."""

import logging
import weakref
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags import rosbag1

from datasets.rosbag.indexed_messages import IndexedMessages, IndexReader, RawMessage, plain

if TYPE_CHECKING:
    from rosbags import rosbag2

logger = logging.getLogger(__name__)


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
        self._indexed = IndexedMessages(self._reader) if isinstance(self._reader, rosbag1.Reader) else None
        self.connections = [plain(connection) for connection in self._reader.connections]
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
        if self._indexed is None:
            known = {connection.id: plain(connection) for connection in connections}
            for connection, time, data in reader.messages(connections):
                yield RawMessage(known[connection.id], time, data)
        elif self._indexed.steps_back(connections, steered_by):
            logger.info("%s: times of %s step back, read in the order of writing", reader.path, steered_by)
            yield from self._indexed.in_order_of_writing(connections)
        else:
            yield from self._indexed.by_time(connections)


def _opened(path: Path, is_ros1: bool) -> "rosbag1.Reader | rosbag2.Reader":
    if is_ros1:
        reader = IndexReader(path)
        reader.open()
        return reader
    from rosbags import rosbag2  # noqa: PLC0415 - slow to load, and a bag of ROS 1 does not need it

    newer = rosbag2.Reader(path)
    newer.open()
    return newer
