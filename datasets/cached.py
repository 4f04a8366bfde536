"""Recordings that are streamed once and then read from memory."""

from collections.abc import Iterator

from datasets.counts import ReadingCounts
from datasets.recording import Recording
from tbmslam.sensing.laser_scan import Reading

_OVERHEAD_BYTES = 1000  # Python objects around the ranges of one reading


def cached(recording: Recording, limit_bytes: int = 512 * 2**20) -> Recording:
    """Return the same recording, kept in memory after its first complete pass where it fits.

    A small bag is then decompressed once although it is read several times; a large one is streamed each time.

    Parameters
    ----------
    recording
        Where the readings come from.
    limit_bytes
        Memory that may be used.
    """
    if limit_bytes < 0:
        raise ValueError(f"limit_bytes must not be negative, got {limit_bytes}")
    memory = _Memory(recording, limit_bytes)
    return Recording(recording.name, memory.stream, recording.description, recording.expected_scans)


class _Memory:
    """Readings of the first complete pass, and what it counted."""

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
