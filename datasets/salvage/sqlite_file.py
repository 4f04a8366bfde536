"""ROS 2 databases that sqlite refuses: the rows of their two tables are found page by page."""

import mmap
from array import array
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from datasets.salvage.salvaged_bag import BagConnection, Hole, SalvagedBag

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
