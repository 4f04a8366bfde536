"""A recording: a stream of readings that can be restarted, its description and its warnings.

The readings may be read ahead in a thread, or be kept in memory.
"""

from collections.abc import Callable, Generator, Iterable, Iterator
from queue import Empty, Queue
from threading import Event, Thread
from typing import TypeAlias, TypeVar

from datasets.counts import SCANS, ReadingCounts, Span, gaps_in_words, in_number
from datasets.errors import DatasetError
from tbmslam.sensing.laser_scan import Reading

Item = TypeVar("Item")
_BLOCK = 256


def in_blocks(items: Iterable[Item]) -> Iterator[list[Item]]:
    """Yield items in blocks; a DatasetError follows the items before it."""
    block: list[Item] = []
    try:
        for item in items:
            block.append(item)
            if len(block) == _BLOCK:
                yield block
                block = []
    except DatasetError:
        yield block
        raise
    yield block


_REMEDIES = {
    "before_odometry": "check --odometry, --odom-frame and --clock-offset",
    "empty": "none of their beams holds a range; check --range-min and --range-max, or choose another --scan-topic",
    "unreadable": "pass --angle-step-deg if only the angle step is wrong, or choose another --scan-topic",
    "impossible_angles": "pass --angle-step-deg",
    "other_frame": "choose another --laser-frame or --scan-topic",
}
"""Remedies for dropped scans, by reason."""

ReadingStream: TypeAlias = Callable[[ReadingCounts], Iterator[Reading]]


class Recording:
    """Readings in the order of the recording; every iteration streams them again.

    Parameters
    ----------
    name
        Short name for messages and files.
    stream
        Starts a pass: yields the readings and fills the counts it is given.
    description
        Everything that was chosen or found out, as JSON can hold it.
    expected_scans
        Upper bound of the number of readings, for progress bars; None if unknown.
    """

    def __init__(
        self, name: str, stream: ReadingStream, description: dict[str, object], expected_scans: int | None = None
    ) -> None:
        self.name = name
        self.description = description
        self.expected_scans = expected_scans
        self.counts = ReadingCounts()
        self._stream = stream

    def __iter__(self) -> Iterator[Reading]:
        """Yield and count the readings; raise a `DatasetError` if the recording is damaged or has no usable scan."""
        counts = ReadingCounts()
        yield from self._stream(counts)
        self.counts = counts
        if counts.scans_used == 0:
            raise DatasetError(f"{self.name}: {_why_nothing(counts)}")


def _why_nothing(counts: ReadingCounts) -> str:
    """Return the reason why a pass gave no reading, in one line."""
    if counts.scans_read == 0:
        return "no scan in the recording: choose another with --scan-topic"
    reasons = ", ".join(f"{number} {reason}" for reason, number in sorted(counts.dropped.items()))
    main = max(counts.dropped, key=lambda reason: counts.dropped[reason], default="")
    remedy = _REMEDIES.get(main, "choose another --scan-topic")
    return f"none of {in_number(counts.scans_read, *SCANS)} can be used ({reasons}): {remedy}"


_DROPPED = {
    "before_odometry": "before the first odometry",
    "impossible_angles": "impossible angles",
    "empty": "empty",
    "duplicate": "there twice",
    "unreadable": "unreadable",
    "other_frame": "from another laser on the same topic",
}
_MANY = 0.01  # least share of all beams that causes a warning


def recording_warnings(recording: Recording, span: Span | None = None) -> list[str]:
    """Return a sentence for each anomaly of the last pass over a recording.

    Only gaps in the mapped `span` count. Other counts have no times and describe the whole recording.
    """
    counts = recording.counts
    counted = _dropped(counts) + counts.anomalies() + _beam_warnings(counts)
    if span is not None:
        counted = [f"in the whole recording, {what}" for what in counted]
    pauses = counts.pauses_in(span)
    warnings = counted + ([f"{gaps_in_words(pauses)}: motion during a gap is unknown"] if pauses else [])
    if recording.description.get("sensor_pose_known") is False:
        warnings.append("the mount of the laser on the robot is not recorded: a default was used")
    frames = recording.description.get("frame_warnings")
    warnings += [str(warning) for warning in frames] if isinstance(frames, list) else []
    first_scan = recording.description.get("first_scan")
    is_given = recording.description.get("angle_step_deg") is not None  # then the stated angle is not used
    angle = first_scan.get("angle_warning") if isinstance(first_scan, dict) and not is_given else None
    return warnings + [str(warning) for warning in (recording.description.get("clock_warning"), angle) if warning]


def _dropped(counts: ReadingCounts) -> list[str]:
    return [
        f"{number} of {in_number(counts.scans_read, 'scan was', 'scans were')} dropped: {_DROPPED.get(reason, reason)}"
        for reason, number in sorted(counts.dropped.items())
    ]


def _beam_warnings(counts: ReadingCounts) -> list[str]:
    total = sum(counts.beams.values())
    return [
        f"{counts.beams[fate] / total:.0%} of the beams {what}"
        for fate, what in (
            ("nan", "are not a number"),
            ("zero", "are zero"),
            ("too_close", "are below the least range of the laser"),
        )
        if counts.beams.get(fate, 0) > _MANY * total
    ]


_AHEAD = 32  # readings of a block, since each exchange between threads costs time
_MOST_BLOCKS = 16  # blocks that are read ahead, to limit the memory

_Blocks: TypeAlias = "Queue[list[Reading] | BaseException]"


def read_ahead(readings: Iterable[Reading]) -> Iterator[Reading]:
    """Yield the same readings in the same order, read by a separate thread.

    Decompressing a bag, and compiled code that uses the readings, leave Python to the other thread. An error of the
    reader is raised here, after the readings before it.
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
            if len(block) == _AHEAD:
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


_CACHE_BYTES = 512 * 2**20
_OVERHEAD_BYTES = 1000  # Python objects around the ranges of one reading


def cached(recording: Recording) -> Recording:
    """Return the same recording, kept in memory after its first complete pass where it fits.

    A small bag is then decompressed once although it is read several times; a large one is streamed each time.
    """
    memory = _Memory(recording)
    return Recording(recording.name, memory.stream, recording.description, recording.expected_scans)


class _Memory:
    """Readings and counts of the first complete pass."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
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
            self._too_large = self._too_large or used > _CACHE_BYTES
            if self._too_large:
                kept.clear()
            else:
                kept.append(reading)
        if not self._too_large:
            self._readings = kept
