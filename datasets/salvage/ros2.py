"""Damaged ROS 2 files: MCAP without a complete index, and databases that sqlite refuses.

The data section of an MCAP file is read from beginning to end. The rows of the two tables of a database are found
page by page.
"""

import mmap
import re
import struct
from array import array
from collections.abc import Iterator
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from datasets.salvage.salvaged_bag import UNKNOWN_LOSS, BagConnection, Hole, SalvagedBag

_MAGIC = 8  # bytes
_HEAD = struct.Struct("<BQ")  # kind and length of a record
_WANTED = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE)
# A chunk: kind, length, three numbers, checksum, name of the compression, length of the records.
_CHUNK = re.compile(rb"\x06(.{8}).{24}.{4}(\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0)(.{8})", re.DOTALL)
_NOT_COMPRESSED = b"\0\0\0\0"
_LARGEST_CHUNK = 1 << 30
_INDEX_HEAD = 15  # size of the index of a channel's messages in a chunk [bytes]
_INDEX_ENTRY = 16  # size for each message [bytes]
_LATEST = (1 << 63) - 1  # [ns]


def has_full_index(path: Path) -> bool:
    """Return whether the index of an MCAP file holds all of its messages, so that rosbags reads them."""
    with path.open("rb") as file:
        reader = make_reader(file)
        profile, summary = reader.get_header().profile, reader.get_summary()
    if profile != "ros2" or summary is None or summary.statistics is None:
        return False
    statistics, chunks = summary.statistics, summary.chunk_indexes
    indexed = sum(chunk.message_index_length - _INDEX_HEAD * len(chunk.message_index_offsets) for chunk in chunks)
    return indexed == _INDEX_ENTRY * statistics.message_count and _describes_all(statistics, summary)


def _describes_all(statistics: Statistics, summary: Summary) -> bool:
    """Return whether the statistics count the messages of each channel, and the summary describes each channel."""
    counts, channels = statistics.channel_message_counts, summary.channels
    if sum(counts.values()) != statistics.message_count or not counts.keys() <= channels.keys():
        return False
    return {channels[number].schema_id for number in counts} <= summary.schemas.keys()


def salvage_mcap(path: Path, reason: str) -> SalvagedBag:
    """Read the records of an MCAP file without its index, with the readable parts of damaged chunks."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
        scan = _Scan(buffer)
        scan.read()
    if not scan.is_whole:
        reason += f", {UNKNOWN_LOSS}"
    entries = np.frombuffer(scan.entries, dtype=np.int64).reshape(-1, 5)
    connections = [
        BagConnection(number, channel.topic, scan.schemas.get(channel.schema_id, ""), "")
        for number, channel in scan.channels.items()
    ]
    return SalvagedBag.of(path, reason, connections, entries, scan.holes, partial(_messages_of_chunk, path))


class _Scan:
    """The found messages, channels and holes."""

    def __init__(self, buffer: mmap.mmap) -> None:
        self.entries = array("q")
        self.schemas: dict[int, str] = {}
        self.channels: dict[int, Channel] = {}
        self.holes: list[Hole] = []
        self.is_whole = False
        self._buffer = buffer

    def read(self) -> None:
        """Read all records."""
        position, end = _MAGIC, len(self._buffer)
        while position + _HEAD.size <= end:
            opcode, length = _HEAD.unpack_from(self._buffer, position)
            if opcode == Opcode.DATA_END:
                self.is_whole = True
                return
            following = position + _HEAD.size + length
            inside = _CHUNK.match(self._buffer, position)
            if 0 < opcode < Opcode.DATA_END and following <= end and self._add_record(opcode, position):
                position = following
            elif inside is not None and inside[2] == _NOT_COMPRESSED:
                position = inside.end()  # so that its records are read up to the damage
            else:
                following = self._next_chunk(position + 1)
                self.holes.append(Hole(len(self.entries) // 5, following - position))
                position = following

    def _add_record(self, opcode: int, position: int) -> bool:
        """Add a record; return whether it is valid."""
        if opcode not in _WANTED:
            return True
        records = _records_at(self._buffer, position)
        if records is None:
            return False
        place = 0
        for record in records:
            if isinstance(record, Schema):
                self.schemas[record.id] = record.name
            elif isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Message):
                size = len(record.data)
                if record.log_time > _LATEST:  # the numbers of the file are unsigned
                    self.holes.append(Hole(len(self.entries) // 5, size))
                    place += size
                    continue
                self.entries.extend((record.log_time, record.channel_id, position, place, size))
                place += size
        return True

    def _next_chunk(self, position: int) -> int:
        """Return the position of the next chunk; the end of the file if there is none."""
        for found in _CHUNK.finditer(self._buffer, position):
            length, records = (int.from_bytes(found[group], "little") for group in (1, 3))
            if found.start() + _HEAD.size + length == found.end() + records <= len(self._buffer):
                return found.start()
        return len(self._buffer)


def _messages_of_chunk(path: Path, position: int) -> bytes:
    """Return the data of the messages of the chunk at a position of an MCAP file."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
        records = _records_at(buffer, position) or []
    return b"".join(record.data for record in records if isinstance(record, Message))


def _records_at(buffer: mmap.mmap, position: int) -> list[McapRecord] | None:
    """Return the record at a place, or those in the chunk there; None if it is damaged."""
    _, length = _HEAD.unpack_from(buffer, position)
    stream = BytesIO(buffer[position : min(position + _HEAD.size + length, len(buffer))])
    try:
        record = next(iter(StreamReader(stream, skip_magic=True, emit_chunks=True).records))
        if not isinstance(record, Chunk):
            return [record]
        if record.uncompressed_size > _LARGEST_CHUNK:
            return None
        return breakup_chunk(record, validate_crc=True)
    except Exception:  # noqa: BLE001 - mcap and the decompressors raise anything on damaged bytes
        return None


_LEAF = 13  # kind of the pages with rows of a table
_HEADER = 100  # bytes of the file's header
_WIDTHS = (0, 1, 2, 3, 4, 6, 8, 8, 0, 0)  # bytes of values of the kinds 0 to 9
_LONGEST = 1 << 26  # of a row [bytes]


def salvage_sqlite(path: Path, reason: str) -> SalvagedBag:
    """Read the messages of a ROS 2 database from its pages in the order of their numbers."""
    rows, topics = array("q"), {}
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
        pages = _Pages(buffer)
        for number, place, row in pages.rows():
            match row:
                case [None, int(topic), int(time), bytes(data)]:
                    rows.extend((time, topic, place, 0, len(data), number))
                case [None, str(name), str(msgtype), "cdr", *_]:
                    topics[number] = BagConnection(number, name, msgtype, "")
    table = np.frombuffer(rows, dtype=np.int64).reshape(-1, 6)
    _, first = np.unique(table[:, 5], return_index=True)  # sorted by number, which is the order of writing
    known = table[first][np.isin(table[first, 1], list(topics))]
    holes = _holes(known, pages.missing)
    return SalvagedBag.of(path, reason, topics.values(), known[:, :5], holes, partial(_data_of_row, path))


def _holes(rows: np.ndarray[tuple[int, ...], np.dtype[np.int64]], missing: float) -> tuple[Hole, ...]:
    """Return the gaps in the numbers of rows, and the share of the file that is cut off."""
    after = (np.flatnonzero(np.diff(rows[:, 5]) > 1) + 1).tolist()
    holes = [Hole(place, 0) for place in after]
    if missing > 0.0:
        holes.append(Hole(len(rows), round(missing * int(rows[:, 4].sum()))))
    return tuple(holes)


def _data_of_row(path: Path, position: int) -> bytes:
    """Return the message of the row at a position of a database."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
        row = _Pages(buffer).row_at(position)
    return row[1][-1] if row is not None and isinstance(row[1][-1], bytes) else b""


class _Pages:
    """Pages of a database; `missing` is the size of the missing part divided by that of the file."""

    def __init__(self, buffer: mmap.mmap) -> None:
        if len(buffer) <= _HEADER:
            raise ValueError(f"{len(buffer)} bytes are no database")
        self._buffer = buffer
        size = int.from_bytes(buffer[16:18], "big")
        self._size = 65536 if size == 1 else size
        if self._size < 512 or self._size & (self._size - 1):
            self._size = 4096
        self._usable = self._size - buffer[20]
        stated = int.from_bytes(buffer[28:32], "big") * self._size
        self.missing = max(stated - len(buffer), 0) / len(buffer) if stated < 1000 * len(buffer) else 0.0

    def rows(self) -> Iterator[tuple[int, int, list[object]]]:
        """Yield number, position and values of every readable row."""
        for page in range(0, len(self._buffer), self._size):
            head = page + (_HEADER if page == 0 else 0)
            if self._buffer[head] != _LEAF:
                continue
            count = int.from_bytes(self._buffer[head + 3 : head + 5], "big")
            for cell in range(head + 8, min(head + 8 + 2 * count, page + self._size), 2):
                place = page + int.from_bytes(self._buffer[cell : cell + 2], "big")
                row = self.row_at(place)
                if row is not None:
                    yield row[0], place, row[1]

    def row_at(self, place: int) -> tuple[int, list[object]] | None:
        """Return number and values of the row at a position; None if it is damaged."""
        try:
            length, start = _varint(self._buffer, place)
            number, start = _varint(self._buffer, start)
            payload = self._payload(start, length)
            return (number, _values(payload)) if payload is not None else None
        except (IndexError, UnicodeDecodeError):
            return None

    def _payload(self, start: int, length: int) -> bytes | None:
        """Return a row's bytes, from its page and its chain of overflow pages."""
        if not 0 < length <= _LONGEST:
            return None
        here = self._size_in_page(length)
        parts = [self._buffer[start : start + here]]
        left, place = length - here, start + here
        while left > 0:
            page = (int.from_bytes(self._buffer[place : place + 4], "big") - 1) * self._size
            if page < 0 or page + self._size > len(self._buffer):
                return None
            parts.append(self._buffer[page + 4 : page + min(self._usable, 4 + left)])
            left, place = left - (self._usable - 4), page
        payload = b"".join(parts)
        return payload if len(payload) == length else None

    def _size_in_page(self, length: int) -> int:
        """Return the number of bytes of a payload in the leaf itself."""
        most = self._usable - 35
        if length <= most:
            return length
        least = (self._usable - 12) * 32 // 255 - 23
        kept = least + (length - least) % (self._usable - 4)
        return kept if kept <= most else least


def _values(payload: bytes) -> list[object]:
    """Return a row's values. Floating point numbers, which the tables do not have, stay bytes."""
    header, position = _varint(payload, 0)
    values: list[object] = []
    place = header
    while position < header:
        kind, position = _varint(payload, position)
        width = _WIDTHS[kind] if kind < len(_WIDTHS) else (kind - 12) // 2
        content = payload[place : place + width]
        if len(content) < width:
            raise IndexError(place)
        values.append(_value(kind, content))
        place += width
    return values


def _value(kind: int, content: bytes) -> object:
    if kind == 0:
        return None
    if kind in (8, 9):
        return kind - 8
    if kind < 7:
        return int.from_bytes(content, "big", signed=True)
    return content.decode() if kind >= 13 and kind % 2 else content


def _varint(buffer: mmap.mmap | bytes, position: int) -> tuple[int, int]:
    """Return a number of one to nine bytes, and the position of its end."""
    value = 0
    for _ in range(8):
        byte = buffer[position]
        position += 1
        value = value << 7 | byte & 127
        if byte < 128:
            return value, position
    return value << 8 | buffer[position], position + 1
