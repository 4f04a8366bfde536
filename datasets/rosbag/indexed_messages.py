"""Messages of an intact ROS 1 bag, read by its index."""

import struct
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from heapq import merge
from itertools import pairwise, repeat
from operator import itemgetter
from typing import NamedTuple, TypeAlias

from rosbags.interfaces import Connection, ConnectionExtRosbag1
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import IndexData, read_bytes

from datasets.salvage.salvaged_bag import BagConnection

_KEPT_CHUNKS = 6
_SIZE = struct.Struct("<I")
_TIME_AND_SIZE = struct.Struct("<III")
_OP, _CONNECTION, _TIME = b"\x04\x00\x00\x00op=\x02", b"\x09\x00\x00\x00conn=", b"\x0d\x00\x00\x00time="
_HEADER_SIZE = len(_OP) + len(_CONNECTION) + 4 + len(_TIME) + 8
_BEFORE_DATA = 4 + _HEADER_SIZE + 4
"""Bytes of a message's record before its data: the sizes of header and data, and the header."""

_PLACE: Callable[[IndexData], tuple[int, int]] = itemgetter(1, 2)
_Entry: TypeAlias = tuple[IndexData, BagConnection]


class RawMessage(NamedTuple):
    """One message with its bytes."""

    connection: BagConnection
    time: int
    data: bytes


class IndexedMessages:
    """The messages of a bag, from an open reader of rosbags.

    rosbags reads the index. Its parsing of each message header takes longer than decompression. Nearly all headers have
    one of two layouts: these are compared as a whole here, and rosbags reads all others. Some decompressed chunks are
    kept, since reading by time alternates between the chunks of different topics.
    """

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        kept = {chunk.decompressor: lru_cache(_KEPT_CHUNKS)(chunk.decompressor) for chunk in reader.chunks.values()}
        reader.chunks = {
            place: chunk._replace(decompressor=kept[chunk.decompressor]) for place, chunk in reader.chunks.items()
        }
        self._by_place: dict[int, list[IndexData]] = {}
        self._chunk = lru_cache(_KEPT_CHUNKS)(partial(_decompressed, reader))

    def by_time(self, connections: Sequence[Connection]) -> Iterator[RawMessage]:
        """Yield messages by time; messages of equal times in the order of their connections."""
        listed = (zip(self._reader.indexes[c.id], repeat(plain(c))) for c in connections)
        return self._read(merge(*listed, key=_time_of))

    def in_order_of_writing(self, connections: Sequence[Connection]) -> Iterator[RawMessage]:
        """Yield messages as they lie in the file."""
        for connection in connections:
            if connection.id not in self._by_place:
                self._by_place[connection.id] = sorted(self._reader.indexes[connection.id], key=_PLACE)
        listed = (zip(self._by_place[c.id], repeat(plain(c))) for c in connections)
        return self._read(merge(*listed, key=_place_of))

    def steps_back(self, connections: Sequence[Connection], topic: str) -> bool:
        """Return whether the messages of a topic were recorded in another order than that of their times."""
        return any(
            later < earlier
            for connection in connections
            if connection.topic == topic
            for earlier, later in pairwise(map(_PLACE, self._reader.indexes[connection.id]))
        )

    def _read(self, entries: Iterator[_Entry]) -> Iterator[RawMessage]:
        """Yield the messages at some places, in their order."""
        headers: dict[int, tuple[bytes, ...]] = {}
        place, chunk = -1, b""
        for entry, connection in entries:
            time, position, offset = entry
            if position != place:
                place, chunk = position, self._chunk(position)
            usual = headers.get(connection.id) or headers.setdefault(connection.id, _usual_headers(connection.id))
            start = offset + _BEFORE_DATA
            if chunk.startswith(usual, offset) and len(chunk) >= start:
                seconds, nanoseconds, size = _TIME_AND_SIZE.unpack_from(chunk, start - _TIME_AND_SIZE.size)
                data = chunk[start : start + size]
                if len(data) == size and time == seconds * 10**9 + nanoseconds:
                    yield RawMessage(connection, time, data)
                    continue
            yield self._read_by_rosbags(entry, connection)

    def _read_by_rosbags(self, entry: IndexData, connection: BagConnection) -> RawMessage:
        """Return the message at a place; rosbags raises anything where there is none."""
        reader = self._reader
        indexes = reader.indexes
        (listed,) = (each for each in reader.connections if each.id == connection.id)
        reader.indexes = {**indexes, connection.id: [entry]}
        try:
            ((found, time, data),) = reader.messages([listed])
        finally:
            reader.indexes = indexes
        return RawMessage(plain(found), time, data)


def plain(connection: Connection) -> BagConnection:
    """Return a connection without its reader."""
    facts = (connection.id, connection.topic, connection.msgtype, connection.digest, connection.msgcount)
    return BagConnection(*facts, is_ros1=isinstance(connection.ext, ConnectionExtRosbag1))


def _decompressed(reader: Reader, place: int) -> bytes:
    """Return the records of a chunk."""
    chunk = reader.chunks[place]
    if reader.bio is None:
        raise ValueError(f"{reader.path} was closed while it was read")
    reader.bio.seek(chunk.datapos)
    return chunk.decompressor(read_bytes(reader.bio, chunk.datasize))


def _usual_headers(connection: int) -> tuple[bytes, ...]:
    """Return how the header of a message's record begins, up to its time, as rosbag's recorder and library write it.

    See http://wiki.ros.org/Bags/Format/2.0, op 0x02.
    """
    of_connection = _CONNECTION + _SIZE.pack(connection)
    size = _SIZE.pack(_HEADER_SIZE)
    return (size + of_connection + _OP + _TIME, size + _OP + of_connection + _TIME)


def _time_of(listed: _Entry) -> int:
    """Return when a message was recorded [ns]."""
    return listed[0][0]


def _place_of(listed: _Entry) -> tuple[int, int]:
    """Return the place of a message: its chunk and its offset there."""
    return _PLACE(listed[0])
