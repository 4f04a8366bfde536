"""Whether bags that are given as one recording are of several robots."""

import hashlib
from collections.abc import Sequence
from itertools import combinations

from datasets.errors import DatasetError
from datasets.rosbag.source import BagSource

_MOST = 0.5
"""Share of the shorter bag's time, and of the scans: parts of one drive overlap by less, and hold the same there."""


def check_for_robots(sources: Sequence[BagSource], topic: str) -> None:
    """Refuse bags that hold different scans from the same time, as those of two robots do.

    Woven into each other they are no drive. A bag that is given twice, or recorded anew, holds the same scans.

    Parameters
    ----------
    sources
        The bags.
    topic
        Of the scans.

    Raises
    ------
    DatasetError
        Two of them are of two robots.
    """
    holding = [source for source in sources if any(c.topic == topic and c.msgcount for c in source.connections)]
    for one, other in combinations(holding, 2):
        if _overlap(one, other) and not _alike(one, other, topic):
            raise DatasetError(
                f"{one.path} and {other.path} hold different scans of {topic} from the same time: "
                "if they are of two robots, pass --separate, else give one of them"
            )


def _overlap(one: BagSource, other: BagSource) -> bool:
    """Return whether most of a bag's time is another's, too; what is not known is no reason to say so."""
    if one.span is None or other.span is None:
        return False
    common = min(one.span[1], other.span[1]) - max(one.span[0], other.span[0])
    return common > _MOST * min(last - first for first, last in (one.span, other.span))


def _alike(one: BagSource, other: BagSource, topic: str) -> bool:
    """Return whether most of the scans of one bag are in another, too."""
    held = [
        {hashlib.blake2b(message.data, digest_size=16).digest() for message in source.messages([topic], topic)}
        for source in (one, other)
    ]
    return len(held[0] & held[1]) > _MOST * min(map(len, held))
