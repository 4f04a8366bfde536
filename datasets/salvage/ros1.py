"""ROS 1 bags whose index is missing or wrong: every message is found again by its own record."""

import mmap
from array import array
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rosbags.typesys.msg import normalize_msgtype

from datasets.salvage.ros1_records import (
    BAG_HEADER,
    CHUNK,
    CONNECTION,
    INDEX,
    MESSAGE,
    Buffer,
    Record,
    decompressed,
    fields_of,
    next_record,
    record_at,
)
from datasets.salvage.salvaged_bag import BagConnection, Hole, SalvagedBag

_FILE = -1  # number of the block that is the file itself
_MOST_MISSING = 1000  # a bag that claims to have been so many times larger has a damaged header instead


def salvage_ros1(path: Path, reason: str) -> SalvagedBag:
    """Read the records of a ROS 1 bag from beginning to end, whatever its index says.

    Messages of chunks that are not compressed are found even where the chunk's own record is damaged; of a damaged
    compressed chunk, what lies before the damage.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
        scan = _Scan()
        scan.read(buffer, buffer.find(b"\n") + 1, _FILE)
        entries = np.frombuffer(scan.entries, dtype=np.int64).reshape(-1, 5)
        if len(buffer) < scan.index_place < _MOST_MISSING * len(buffer) and scan.has_whole:
            scan.holes = [hole for hole in scan.holes if hole.after < len(entries)]
            scan.holes.append(Hole(len(entries), scan.missing(entries[:, 4])))
    known = entries[np.isin(entries[:, 1], list(scan.connections))]
    connections = [
        connection._replace(msgcount=int((known[:, 1] == connection.id).sum()))
        for connection in scan.connections.values()
    ]
    return SalvagedBag(path, reason, connections, known, tuple(scan.holes), _Blocks(path))


class _Scan:
    """Messages, connections and holes found so far."""

    def __init__(self) -> None:
        self.entries = array("q")
        self.connections: dict[int, BagConnection] = {}
        self.holes: list[Hole] = []
        self.index_place = 0
        self._read_whole = (0, 0)

    def __len__(self) -> int:
        return len(self.entries) // 5

    def read(self, buffer: Buffer, position: int, block: int) -> None:
        """Read the records of a block."""
        while position < len(buffer):
            record = record_at(buffer, position)
            if record is None:
                found = next_record(buffer, position + 1)
                if not 0 < self.index_place <= position or block != _FILE:  # an index loses no messages
                    self.holes.append(Hole(len(self), found - position))
                position = found
            else:
                position = self._take(buffer, record, position, block)

    @property
    def has_whole(self) -> bool:
        """Whether any message or chunk was read to its end, by which to judge what is missing."""
        return self._read_whole[0] > 0

    def missing(self, sizes: npt.NDArray[np.int64]) -> int:
        """Return how many bytes of messages a cut file lacks, by what its readable part holds of them."""
        place, count = self._read_whole
        each = int(sizes[:count].sum()) / max(place, 1)
        return max(round(each * (self.index_place - place)) - int(sizes[count:].sum()), 0)

    def _take(self, buffer: Buffer, record: Record, position: int, block: int) -> int:
        """Take a record in; return where the next one begins."""
        complete = record.end <= len(buffer)
        if record.op == MESSAGE:
            if not complete:
                found = next_record(buffer, record.start)
                self.holes.append(Hole(len(self), found - position))
                return found
            size = record.end - record.start
            self.entries.extend((record.time_ns(), record.number(b"conn"), block, record.start, size))
            if block == _FILE:
                self._read_whole = (record.end, len(self))
            if not _fits(buffer, record.end):
                found = next_record(buffer, record.start)
                self.holes.append(Hole(len(self), max(found - record.end, 1)))
                return found
        elif record.op == CHUNK:
            return self._enter(buffer, record, position)
        elif record.op == CONNECTION and complete:
            self._connect(record, bytes(buffer[record.start : record.end]))
        elif record.op == BAG_HEADER:
            self.index_place = record.number(b"index_pos")
        # The length of what is no message may be wrong, as in bags of 2010, and still no message be lost.
        return record.end if _fits(buffer, record.end) else next_record(buffer, record.start)

    def _enter(self, buffer: Buffer, chunk: Record, position: int) -> int:
        """Read a chunk; return where to go on, which is its inside where that is not compressed."""
        if chunk.fields[b"compression"] == b"none":
            return chunk.start
        content = decompressed(bytes(buffer[chunk.start : chunk.end]), chunk.fields[b"compression"])
        self.read(content, 0, position)
        stated = chunk.number(b"size")
        if len(content) < stated:
            self.holes.append(Hole(len(self), stated - len(content)))
        else:
            self._read_whole = (chunk.end, len(self))
        # What looks like a message in compressed data is the inside of a chunk.
        return chunk.end if _fits(buffer, chunk.end) else next_record(buffer, chunk.start, (CHUNK, INDEX))

    def _connect(self, record: Record, data: bytes) -> None:
        """Take in what a connection's messages are."""
        fields = fields_of(data)
        if fields is None or b"type" not in fields:
            return
        topic = record.fields[b"topic"].decode("utf-8", "replace")
        topic = "/" * topic.startswith("/") + "/".join(part for part in topic.split("/") if part)
        msgtype = normalize_msgtype(fields[b"type"].decode("utf-8", "replace"))
        digest = fields.get(b"md5sum", b"*").decode("utf-8", "replace")
        number = record.number(b"conn")
        self.connections.setdefault(number, BagConnection(number, topic, msgtype, digest, 0))


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


def _fits(buffer: Buffer, position: int) -> bool:
    """Return whether a record, or the end, lies at a position."""
    return position == len(buffer) or (position < len(buffer) and record_at(buffer, position) is not None)
