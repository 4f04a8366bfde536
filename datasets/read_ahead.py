"""Readings that are read while those before are used."""

from collections.abc import Generator, Iterable, Iterator
from queue import Empty, Queue
from threading import Event, Thread
from typing import TypeAlias

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
    """Put readings into blocks; an empty block, or what was raised, is the end."""
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
            readings.close()  # here, and not when somebody lets go of it: it may have files open
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
