"""Readings that are read ahead, or kept in memory."""

from collections.abc import Generator, Iterable, Iterator
from queue import Empty, Queue
from threading import Event, Thread
from typing import TypeAlias

from datasets.counts import ReadingCounts
from datasets.recording import Recording
from tbmslam.sensing.laser_scan import Reading

_BLOCK = 32  # readings handed over at a time, as each time costs
_MOST_BLOCKS = 16  # that wait to be used; memory stays bounded

_Blocks: TypeAlias = "Queue[list[Reading] | BaseException]"


def read_ahead(readings: Iterable[Reading]) -> Iterator[Reading]:
    """Yield the same readings in the same order, read by a thread of its own.

    Decompressing a bag, and compiled code that uses the readings, leave Python to the other thread. What goes wrong
    in reading is raised here, after the readings before it.
    """
    blocks: _Blocks = Queue(_MOST_BLOCKS)
    stopped = Event()
    reader = Thread(target=_read, args=(iter(readings), blocks, stopped), name="reading ahead", daemon=True)
    try:
        reader.start()
        while block := blocks.get():
            if isinstance(block, BaseException):
                raise block
            yield from block
    finally:
        stopped.set()
        _empty(blocks)  # the reader may wait for room
        if reader.is_alive():  # Ctrl-C may have come while it began
            reader.join()


def _read(readings: Iterator[Reading], blocks: _Blocks, stopped: Event) -> None:
    """Put readings into blocks; an empty block or an exception is the end."""
    block: list[Reading] = []
    end: list[Reading] | BaseException = []
    if stopped.is_set():
        return
    try:
        for reading in readings:
            block.append(reading)
            if len(block) == _BLOCK:
                blocks.put(block)
                block = []
                if stopped.is_set():
                    break
        if isinstance(readings, Generator):
            readings.close()  # here, and not when it is collected: it may have open files
    except BaseException as error:  # noqa: BLE001 - it is raised where the readings are used
        end = error
    if block:
        blocks.put(block)
    blocks.put(end)


def _empty(blocks: _Blocks) -> None:
    try:
        while True:
            blocks.get_nowait()
    except Empty:
        return


_OVERHEAD_BYTES = 1000  # Python objects around the ranges of one reading


def cached(recording: Recording, limit_bytes: int = 512 * 2**20) -> Recording:
    """Return the same recording, kept in memory after its first complete pass where it fits.

    A small bag is then decompressed once although it is read several times; a large one is streamed each time.

    Parameters
    ----------
    recording
        The source of the readings.
    limit_bytes
        Memory that may be used.
    """
    if limit_bytes < 0:
        raise ValueError(f"limit_bytes must not be negative, got {limit_bytes}")
    memory = _Memory(recording, limit_bytes)
    return Recording(recording.name, memory.stream, recording.description, recording.expected_scans)


class _Memory:
    """Readings and counts of the first complete pass."""

    def __init__(self, recording: Recording, limit_bytes: int) -> None:
        self._recording = recording
        self._limit_bytes = limit_bytes
        self._readings: list[Reading] | None = None
        self._too_large = False

    def stream(self, counts: ReadingCounts) -> Iterator[Reading]:
        """Yield the readings from memory, or from the recording and keep them."""
        if self._readings is None:
            yield from self._first_pass()
        else:
            yield from self._readings
        counts.replace_by(self._recording.counts)

    def _first_pass(self) -> Iterator[Reading]:
        """Stream, keeping readings as long as they fit."""
        kept: list[Reading] = []
        used = 0
        for reading in self._recording:
            yield reading
            used += reading.scan.ranges.nbytes + _OVERHEAD_BYTES
            self._too_large = self._too_large or used > self._limit_bytes
            if self._too_large:
                kept.clear()
            else:
                kept.append(reading)
        if not self._too_large:
            self._readings = kept
