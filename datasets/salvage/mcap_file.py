"""MCAP files without a complete index: their data section is read from beginning to end."""

import mmap
import re
import struct
from array import array
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
_ROS_1 = "ros1"  # encoding of messages that were converted from a bag, which rosbags does not read
_LATEST = (1 << 63) - 1  # [ns]


def has_full_index(path: Path) -> bool:
    """Return whether the index of an MCAP file holds all of its messages, so that rosbags reads them."""
    with path.open("rb") as file:
        reader = make_reader(file)
        profile, summary = reader.get_header().profile, reader.get_summary()
    if profile != "ros2" or summary is None or summary.statistics is None:
        return False
    if any(channel.message_encoding == _ROS_1 for channel in summary.channels.values()):
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
        _connection(number, channel, scan.schemas.get(channel.schema_id, ""))
        for number, channel in scan.channels.items()
    ]
    return SalvagedBag.of(path, reason, connections, entries, scan.holes, partial(_messages_of_chunk, path))


def _connection(number: int, channel: Channel, schema: str) -> BagConnection:
    """Return the connection of a channel; a type of ROS 1 gets the name that it has in ROS 2."""
    if channel.message_encoding != _ROS_1:
        return BagConnection(number, channel.topic, schema, "")
    package, _, name = schema.rpartition("/")
    msgtype = schema if not package or "/" in package else f"{package}/msg/{name}"
    return BagConnection(number, channel.topic, msgtype, channel.metadata.get("md5sum", ""), is_ros1=True)


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
