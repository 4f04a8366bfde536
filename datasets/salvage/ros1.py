"""ROS 1 bags (format 2.0) with a missing or wrong index: messages are found by their own records.

The format: http://wiki.ros.org/Bags/Format/2.0. A record is the length of its header, the header, the length of its
data, the data; a header is a row of fields, each the length of ``name=value`` and that text.
"""

import bz2
import mmap
import struct
from array import array
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import NamedTuple, TypeAlias

import lz4.frame
import numpy as np
import numpy.typing as npt
from rosbags.typesys.msg import normalize_msgtype

from datasets.salvage.salvaged_bag import BagConnection, Hole, SalvagedBag

Buffer: TypeAlias = bytes | mmap.mmap

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7

_LONGEST_HEADER = 4096  # the name of a topic is the longest field
_MARK = b"\x04\0\0\0op="  # part of every header
_NEEDED: dict[int, dict[bytes, int | None]] = {
    MESSAGE: {b"conn": 4, b"time": 8},
    BAG_HEADER: {b"index_pos": 8},
    INDEX: {b"conn": 4, b"count": 4},
    CHUNK: {b"compression": None, b"size": 4},
    CHUNK_INFO: {b"chunk_pos": 8},
    CONNECTION: {b"conn": 4, b"topic": None},
}
_ZEROS = b"\0\0"  # the upper half of such a number
_FOUR_BYTES = struct.Struct("<L")
_PIECE = 1 << 16
_LARGEST_CHUNK = 1 << 30


class Record(NamedTuple):
    """A record with its data from `start` to `end`, which may be beyond the end of the file."""

    op: int
    fields: dict[bytes, bytes]
    start: int
    end: int

    def number(self, name: bytes) -> int:
        """Return a field as an unsigned number."""
        return int.from_bytes(self.fields[name], "little")

    def time_ns(self) -> int:
        """Return the time of recording of a message [ns]."""
        seconds, nanoseconds = struct.unpack("<LL", self.fields[b"time"])
        return int(seconds * 10**9 + nanoseconds)


def record_at(buffer: Buffer, position: int) -> Record | None:
    """Return the record at a position, or None."""
    length = _uint32(buffer, position)
    if length is None or not len(_MARK) < length <= _LONGEST_HEADER:
        return None
    start = position + 4 + length
    size = _uint32(buffer, start)
    fields = fields_of(buffer[position + 4 : start])
    if size is None or fields is None or len(fields.get(b"op", b"")) != 1:
        return None
    op = fields[b"op"][0]
    needed = _NEEDED.get(op)
    if needed is None or any(
        name not in fields or width not in (None, len(fields[name])) for name, width in needed.items()
    ):
        return None
    return Record(op, fields, start + 4, start + 4 + size)


def next_record(buffer: Buffer, position: int, kinds: Collection[int] = tuple(_NEEDED)) -> int:
    """Return the position of the next record of some kinds; the end of the buffer if there is none."""
    mark = buffer.find(_MARK, position)
    while mark >= 0:
        for start in _possible_headers(buffer, max(position, mark - _LONGEST_HEADER), mark - 4):
            length = _uint32(buffer, start)
            if length is not None and start + 4 + length >= mark + len(_MARK):
                record = record_at(buffer, start)
                if record is None:
                    continue
                if record.op in kinds:
                    return start
                break
        mark = buffer.find(_MARK, mark + 1)
    return len(buffer)


def _possible_headers(buffer: Buffer, first: int, last: int) -> Iterator[int]:
    """Yield positions of possible header lengths (numbers below 65536), from the last to the first."""
    window = buffer[first : last + 4]
    found = window.rfind(_ZEROS, 2)
    while found >= 0:
        yield first + found - 2
        found = window.rfind(_ZEROS, 2, found + 1)


def fields_of(header: bytes) -> dict[bytes, bytes] | None:
    """Return the fields of a header; None if it is invalid."""
    fields: dict[bytes, bytes] = {}
    position = 0
    while position < len(header):
        size = _uint32(header, position)
        if size is None or position + 4 + size > len(header):
            return None
        name, equals, value = header[position + 4 : position + 4 + size].partition(b"=")
        if not equals:
            return None
        fields[name] = value
        position += 4 + size
    return fields


def decompressed(data: bytes, compression: bytes) -> bytes:
    """Return the decompressed data of a chunk, up to the first damage."""
    decompressor = _DECOMPRESSORS.get(compression)
    if decompressor is None:
        return b""
    feed, parts, size = decompressor(), [], 0
    for place in range(0, len(data), _PIECE):
        try:
            parts.append(feed(data[place : place + _PIECE]))
        except (OSError, EOFError, RuntimeError, ValueError):
            break
        size += len(parts[-1])
        if size > _LARGEST_CHUNK:
            break
    return b"".join(parts)


_DECOMPRESSORS: dict[bytes, Callable[[], Callable[[bytes], bytes]]] = {
    b"bz2": lambda: bz2.BZ2Decompressor().decompress,
    b"lz4": lambda: lz4.frame.LZ4FrameDecompressor().decompress,
}


def _uint32(buffer: Buffer, position: int) -> int | None:
    try:
        return int(_FOUR_BYTES.unpack_from(buffer, position)[0])
    except struct.error:
        return None


_FILE = -1  # number of the block for the file itself
_MOST_MISSING = 1000  # a bag whose header states more missing parts has a damaged header


def salvage_ros1(path: Path, reason: str) -> SalvagedBag:
    """Read the records of a ROS 1 bag from beginning to end, without its index.

    The messages of an uncompressed chunk are found even if the record of the chunk is damaged. A damaged compressed
    chunk is read up to the damage.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
        scan = _Scan()
        scan.read(buffer, buffer.find(b"\n") + 1, _FILE)
        entries = np.frombuffer(scan.entries, dtype=np.int64).reshape(-1, 5)
        if len(buffer) < scan.index_place < _MOST_MISSING * len(buffer) and scan.has_complete:
            scan.holes = [hole for hole in scan.holes if hole.after < len(entries)]
            scan.holes.append(Hole(len(entries), scan.missing(entries[:, 4])))
    return SalvagedBag.of(path, reason, scan.connections.values(), entries, scan.holes, _Blocks(path))


class _Scan:
    """The found messages, connections and holes."""

    def __init__(self) -> None:
        self.entries = array("q")
        self.connections: dict[int, BagConnection] = {}
        self.holes: list[Hole] = []
        self.index_place = 0
        self._last_complete = (0, 0)

    def __len__(self) -> int:
        return len(self.entries) // 5

    def read(self, buffer: Buffer, position: int, block: int) -> None:
        """Read the records of a block."""
        while position < len(buffer):
            record = record_at(buffer, position)
            if record is None:
                found = next_record(buffer, position + 1)
                if not 0 < self.index_place <= position or block != _FILE:  # damage of an index loses no messages
                    self.holes.append(Hole(len(self), found - position))
                position = found
            else:
                position = self._add_record(buffer, record, position, block)

    @property
    def has_complete(self) -> bool:
        """Whether any message or chunk is complete, so that losses can be estimated."""
        return self._last_complete[0] > 0

    def missing(self, sizes: npt.NDArray[np.int64]) -> int:
        """Return the estimated number of missing bytes of messages of a cut file, by its readable part."""
        place, count = self._last_complete
        each = int(sizes[:count].sum()) / max(place, 1)
        return max(round(each * (self.index_place - place)) - int(sizes[count:].sum()), 0)

    def _add_record(self, buffer: Buffer, record: Record, position: int, block: int) -> int:
        """Add a record; return the position of the next record."""
        complete = record.end <= len(buffer)
        if record.op == MESSAGE:
            if not complete:
                found = next_record(buffer, record.start)
                self.holes.append(Hole(len(self), found - position))
                return found
            size = record.end - record.start
            self.entries.extend((record.time_ns(), record.number(b"conn"), block, record.start, size))
            if block == _FILE:
                self._last_complete = (record.end, len(self))
            if not _is_record_or_end(buffer, record.end):
                found = next_record(buffer, record.start)
                self.holes.append(Hole(len(self), max(found - record.end, 1)))
                return found
        elif record.op == CHUNK:
            return self._read_chunk(buffer, record, position)
        elif record.op == CONNECTION and complete:
            self._add_connection(record, bytes(buffer[record.start : record.end]))
        elif record.op == BAG_HEADER:
            self.index_place = record.number(b"index_pos")
        # Records of other kinds may have wrong lengths, as in bags of 2010, without a loss of messages.
        return record.end if _is_record_or_end(buffer, record.end) else next_record(buffer, record.start)

    def _read_chunk(self, buffer: Buffer, chunk: Record, position: int) -> int:
        """Read a chunk; return the position of the next record, which is inside of an uncompressed chunk."""
        if chunk.fields[b"compression"] == b"none":
            return chunk.start
        content = decompressed(bytes(buffer[chunk.start : chunk.end]), chunk.fields[b"compression"])
        self.read(content, 0, position)
        stated = chunk.number(b"size")
        if len(content) < stated:
            self.holes.append(Hole(len(self), stated - len(content)))
        else:
            self._last_complete = (chunk.end, len(self))
        # Compressed data contain no messages.
        return chunk.end if _is_record_or_end(buffer, chunk.end) else next_record(buffer, chunk.start, (CHUNK, INDEX))

    def _add_connection(self, record: Record, data: bytes) -> None:
        fields = fields_of(data)
        if fields is None or b"type" not in fields:
            return
        topic = record.fields[b"topic"].decode("utf-8", "replace")
        topic = "/" * topic.startswith("/") + "/".join(part for part in topic.split("/") if part)
        msgtype = normalize_msgtype(fields[b"type"].decode("utf-8", "replace"))
        digest = fields.get(b"md5sum", b"*").decode("utf-8", "replace")
        number = record.number(b"conn")
        self.connections.setdefault(number, BagConnection(number, topic, msgtype, digest, is_ros1=True))


class _Blocks:
    """Blocks of a bag: the file itself, and decompressed chunks by their place in the file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: mmap.mmap | None = None

    def __call__(self, number: int) -> bytes:
        """Return a block's bytes."""
        if self._file is None:
            with self._path.open("rb") as file:
                self._file = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        if number == _FILE:
            return self._file  # type: ignore[return-value] # sliced like bytes
        chunk = record_at(self._file, number)
        if chunk is None:
            return b""
        return decompressed(bytes(self._file[chunk.start : chunk.end]), chunk.fields[b"compression"])


def _is_record_or_end(buffer: Buffer, position: int) -> bool:
    """Return whether a record, or the end, lies at a position."""
    return position == len(buffer) or (position < len(buffer) and record_at(buffer, position) is not None)
