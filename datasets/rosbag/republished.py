"""Topics that republish the scans of another topic, perhaps with other stamps."""

import math
from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from datasets.rosbag.files import BagFiles
from datasets.rosbag.messages import FramedScan

_SCANS = 100
_LEAST_EQUAL = 10
"""Number of different scans that both topics must hold, since two lasers may see nothing, or the same for a moment."""
_HALF = 0.5  # least share of the scans of the shorter topic
_NEAR_S = 5.0  # limit of the latency of a scan, and of what a republisher corrects
_SAME_STAMP_S = 1e-3


class Republished(NamedTuple):
    """Topics that hold the same scans."""

    best: str
    others: tuple[str, ...]
    later: float
    """Time by which the stamps of the others are later at least, 0 if equal [s]."""

    def text(self) -> str:
        """Return what is done, in one line."""
        stamped = f", stamped {self.later:.2f} s earlier" if self.later else ", which were published first"
        return (
            f"{' and '.join([self.best, *self.others])} hold the same scans: those of {self.best} are used{stamped}; "
            f"pass --scan-topic {self.others[0]} for the other"
        )


class _Held(NamedTuple):
    """Stamp and bag time of a topic's first scans, by frame and ranges."""

    name: str
    times: dict[tuple[str, bytes], tuple[float, float]]

    def delay(self, other: "_Held") -> tuple[float, float] | None:
        """Return by how much another topic's stamps and bag times of the same scans are later [s]; None if they differ.

        The stamps' delay is 0 if some are unset.
        """
        common = self.times.keys() & other.times.keys()
        apart = [np.subtract(other.times[scan], self.times[scan]) for scan in common]
        near = [step for step in apart if not abs(step[0]) > _NEAR_S and abs(step[1]) < _NEAR_S]
        if len(near) < max(_LEAST_EQUAL, _HALF * min(len(self.times), len(other.times))):
            return None
        stamps, bag_times = np.median(near, axis=0).tolist()
        return (stamps if abs(stamps) > _SAME_STAMP_S else 0.0, bag_times)


def republished(files: BagFiles, topics: Sequence[str]) -> Republished | None:
    """Return the topic to use if all topics hold the same scans; None if one holds others.

    A scan is stamped after it was measured, so the earliest stamps have the least delay. On 13 recordings of Neatos,
    odometry and scans disagreed 9 times by the driver's stamps, and once by those 0.3 s earlier that a second node gave
    the same scans. If the stamps are equal, the scans that were published first are used.
    """
    first, *others = (_held(files, name) for name in topics)
    delays = {first.name: (0.0, 0.0)}
    for other in others:
        delay = first.delay(other)
        if delay is None:
            return None
        delays[other.name] = delay
    best = min(delays, key=lambda name: delays[name])
    rest = tuple(name for name in delays if name != best)
    return Republished(best, rest, min(delays[name][0] for name in rest) - delays[best][0])


def _held(files: BagFiles, topic: str) -> _Held:
    """Return the first scans of a topic; of equal scans the first, and none whose ranges are all equal."""
    times: dict[tuple[str, bytes], tuple[float, float]] = {}
    for message in islice(files.messages([topic], topic), _SCANS):
        content = message.content
        if isinstance(content, FramedScan) and len(set(content.scan.ranges.tolist())) > 1:
            stamp = content.stamped(math.nan).stamp
            times.setdefault((content.frame, content.scan.ranges.tobytes()), (stamp, message.bag_time))
    return _Held(topic, times)
