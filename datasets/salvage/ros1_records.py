"""Records of ROS 1 bags (format 2.0), found again where the file is damaged.

The format: http://wiki.ros.org/Bags/Format/2.0. A record is the length of its header, the header, the length of its
data, the data; a header is a row of fields, each the length of ``name=value`` and that text.
"""

import bz2
import mmap
import struct
from collections.abc import Callable, Collection, Iterator
from typing import NamedTuple, TypeAlias

import lz4.frame

Buffer: TypeAlias = bytes | mmap.mmap

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7

_LONGEST_HEADER = 4096  # topics have names; nothing else in a header is long
_MARK = b"\x04\0\0\0op="  # stands in every header
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
    """One record; its data lie from `start` to `end`, which may be beyond what is there."""

    op: int
    fields: dict[bytes, bytes]
    start: int
    end: int

    def number(self, name: bytes) -> int:
        """Return a field that holds an unsigned number."""
        return int.from_bytes(self.fields[name], "little")

    def time_ns(self) -> int:
        """Return when a message was recorded [ns]."""
        seconds, nanoseconds = struct.unpack("<LL", self.fields[b"time"])
        return int(seconds * 10**9 + nanoseconds)


def record_at(buffer: Buffer, position: int) -> Record | None:
    """Return the record that begins at a position; None where none does."""
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
    """Return where the next record of some kinds begins, at or after a position; the buffer's end without any."""
    mark = buffer.find(_MARK, position)
    while mark >= 0:
        for start in _short_lengths(buffer, max(position, mark - _LONGEST_HEADER), mark - 4):
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


def _short_lengths(buffer: Buffer, first: int, last: int) -> Iterator[int]:
    """Yield the places, from the last to the first, where a number below 65536 may stand, as a header's length is."""
    window = buffer[first : last + 4]
    found = window.rfind(_ZEROS, 2)
    while found >= 0:
        yield first + found - 2
        found = window.rfind(_ZEROS, 2, found + 1)


def fields_of(header: bytes) -> dict[bytes, bytes] | None:
    """Return the fields of a header; None where it is not made of fields."""
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
    """Return what can be decompressed of a chunk's data: all of it, or what comes before the damage."""
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


def _lz4() -> Callable[[bytes], bytes]:
    decompress: Callable[[bytes], bytes] = lz4.frame.LZ4FrameDecompressor().decompress
    return decompress


_DECOMPRESSORS: dict[bytes, Callable[[], Callable[[bytes], bytes]]] = {
    b"bz2": lambda: bz2.BZ2Decompressor().decompress,
    b"lz4": _lz4,
}


def _uint32(buffer: Buffer, position: int) -> int | None:
    try:
        return int(_FOUR_BYTES.unpack_from(buffer, position)[0])
    except struct.error:
        return None
