"""Topics that republish the scans of another topic, perhaps with other stamps."""

import math
from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from datasets.rosbag.files import BagFiles, Topic
from datasets.rosbag.messages import CLOUD_TYPE, FramedScan

_SCANS = 100
_LEAST_EQUAL = 10
"""Number of different scans that both topics must hold, since two lasers may see nothing, or the same for a moment."""
_HALF = 0.5  # least share of the scans of the shorter topic
_NEAR_S = 5.0  # limit of the latency of a scan, and of what a republisher corrects
_SAME_STAMP_S = 1e-3
_MISSING = 0.05  # share of the scans by which topics may differ, since a recorder drops some


class Republished(NamedTuple):
    """Topics that hold the same scans."""

    best: str
    others: tuple[str, ...]
    later: float
    """Least time by which the stamps of the other topics are later [s]; 0 if the stamps are equal."""
    why: str
    """Difference between the chosen topic and the next best."""

    def text(self) -> str:
        """Return what is done, in one line."""
        every = " and ".join([self.best, *self.others])
        return (
            f"{every} hold the same scans: those of {self.best} are used, {self.why}; "
            f"pass --scan-topic {self.others[0]} for that topic"
        )


class _Held(NamedTuple):
    """Stamp and bag time of a topic's first scans, by frame and ranges."""

    topic: Topic
    times: dict[tuple[str, bytes], tuple[float, float]]

    def has_unset_stamps(self) -> bool:
        """Return whether a stamp is unset."""
        return any(math.isnan(stamp) for stamp, _ in self.times.values())

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


class _Rank(NamedTuple):
    """Order of topics with the same scans: the least is the best."""

    has_unset_stamps: bool
    stamps_delay: float
    bag_time_delay: float
    missing: int
    name: str


def republished(files: BagFiles, topics: Sequence[Topic]) -> Republished | None:
    """Return the topic to use if all topics hold the same scans; None if one holds others, or fewer.

    A scan is stamped after it was measured, so the earliest stamps have the least delay. On 13 recordings of Neatos,
    odometry and scans disagreed 9 times by the driver's stamps, and once by those 0.3 s earlier that a second node gave
    the same scans. If the stamps are equal, the scans that were published first are used.
    Point clouds are not compared.
    """
    counts = [topic.messages for topic in topics]
    most = max(counts)
    is_short = min(counts) < max(_LEAST_EQUAL, min(most - 1, (1.0 - _MISSING) * most))
    if is_short or any(topic.msgtype == CLOUD_TYPE for topic in topics):
        return None
    first, *others = sorted((_held(files, topic) for topic in topics), key=_Held.has_unset_stamps)
    ranks = [_Rank(first.has_unset_stamps(), 0.0, 0.0, most - first.topic.messages, first.topic.name)]
    for other in others:
        delay = first.delay(other)
        if delay is None:
            return None
        ranks.append(_Rank(other.has_unset_stamps(), *delay, most - other.topic.messages, other.topic.name))
    best, second = sorted(ranks)[:2]
    rest = tuple(topic.name for topic in topics if topic.name != best.name)
    return Republished(best.name, rest, second.stamps_delay - best.stamps_delay, _difference(best, second))


def _difference(best: _Rank, second: _Rank) -> str:
    """Return how the scans of a topic differ from those of the next best."""
    later = second.stamps_delay - best.stamps_delay
    if second.has_unset_stamps > best.has_unset_stamps:
        return "whose stamps are set"
    if later:
        return f"stamped {later:.2f} s earlier"
    return "which were published first" if second.bag_time_delay != best.bag_time_delay else "with equal stamps"


def _held(files: BagFiles, topic: Topic) -> _Held:
    """Return the first scans of a topic.

    Equal scans count once. Scans with equal ranges only are left out.
    """
    times: dict[tuple[str, bytes], tuple[float, float]] = {}
    for message in islice(files.messages([topic.name], topic.name), _SCANS):
        content = message.content
        if isinstance(content, FramedScan) and np.unique(content.scan.ranges).size > 1:
            stamp = content.stamped(math.nan).stamp
            times.setdefault((content.frame, content.scan.ranges.tobytes()), (stamp, message.bag_time))
    return _Held(topic, times)
