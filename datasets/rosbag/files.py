"""Bag files as one stream of decoded messages."""

import hashlib
from collections.abc import Collection, Iterator
from heapq import merge
from itertools import combinations, islice, pairwise
from pathlib import Path
from typing import Any, NamedTuple

from datasets.clouds import CloudSlice, PointCloud
from datasets.errors import DatasetError
from datasets.rosbag.messages import Content, FramedScan, MessageDecoder, standard_md5_sum
from datasets.rosbag.source import BagSource
from datasets.salvage.salvaged_bag import BagConnection, Loss

_HALF = 0.5
"""Share of the shorter bag above which two bags overlap in time, or hold the same scans."""

_LONG_PAUSE_NS = 600 * 10**9
"""Time between the files of one drive that causes a warning: a recorder begins a new file within seconds."""


def _overlap(bag: BagSource, other: BagSource) -> bool:
    """Return whether most of a bag's time overlaps with another's; False if unknown."""
    if bag.span is None or other.span is None:
        return False
    common = min(bag.span[1], other.span[1]) - max(bag.span[0], other.span[0])
    return common > _HALF * min(last - first for first, last in (bag.span, other.span))


def _alike(bag: BagSource, other: BagSource, topic: str) -> bool:
    """Return whether most scans of one bag are also in another bag."""
    held = [
        {hashlib.blake2b(message.data, digest_size=16).digest() for message in source.messages([topic], topic)}
        for source in (bag, other)
    ]
    return len(held[0] & held[1]) > _HALF * min(map(len, held))


class Topic(NamedTuple):
    """One topic of a recording."""

    name: str
    msgtype: str
    messages: int


class Message(NamedTuple):
    """One decoded message; None if its bytes cannot be decoded."""

    topic: str
    msgtype: str
    bag_time: float
    content: Content | None


class BagFiles:
    """ROS 1 bag files, or ROS 2 bag directories or storage files, read as one recording.

    Messages are decoded by the standard definitions of their types instead of those of the bag. So unparsable
    definitions do no harm, and bags without definitions (ROS 2 Humble) can be read. Damaged files are salvaged.
    """

    def __init__(self, paths: list[Path]) -> None:
        self.paths = paths
        self.topics: dict[str, Topic] = {}
        self._cut: CloudSlice | None = None
        self._sources = [BagSource(path) for path in paths]
        for source in self._sources:
            for connection in source.connections:
                self._add(connection)

    def of_type(self, *msgtypes: str) -> list[Topic]:
        """Return the topics of some message types, sorted by name."""
        return sorted(topic for topic in self.topics.values() if topic.msgtype in msgtypes)

    def first_clouds(self, topic: str, count: int) -> list[PointCloud]:
        """Return the first point clouds of a topic, at most `count`; unreadable clouds are left out."""
        clouds: list[PointCloud] = []
        for source in self._sources:
            decoders = _decoders()
            for connection, _, data in islice(source.messages([topic], topic), count - len(clouds)):
                cloud = decoders[connection.is_ros1].decoded(connection.msgtype, data)
                if isinstance(cloud, PointCloud):
                    clouds.append(cloud)
        return clouds

    def whole_messages(self, topics: Collection[str], steered_by: str) -> Iterator[tuple[str, float, Any]]:
        """Yield message type, bag time [s] and message with all of its fields, file by file; without unreadable ones.

        This is slow: `messages` decodes only what a pass needs.
        """
        for source in self._sources:
            decoders = _decoders()
            for connection, time, data in source.messages(topics, steered_by):
                message = decoders[connection.is_ros1].whole(connection.msgtype, data)
                if message is not None:
                    yield connection.msgtype, 1e-9 * time, message

    def slice_clouds(self, cut: CloudSlice) -> None:
        """Read point clouds as scans from now on: each by this slice."""
        self._cut = cut

    def check_for_robots(self, scan_topic: str) -> None:
        """Refuse files that hold different scans of the same time, such as bags of two robots.

        Merged by time, they are not one drive. A bag that is given twice, or recorded again, holds the same scans.
        """
        holding = [s for s in self._sources if any(c.topic == scan_topic and c.msgcount for c in s.connections)]
        for bag, other in combinations(holding, 2):
            if _overlap(bag, other) and not _alike(bag, other, scan_topic):
                raise DatasetError(
                    f"{bag.path} and {other.path} hold different scans of {scan_topic} from the same time: "
                    "if they are of two robots, pass --separate, else give one of them"
                )

    def pauses(self) -> list[str]:
        """Return a warning for each long pause between two files."""
        known = sorted((source.span, source.path) for source in self._sources if source.span is not None)
        return [
            f"{after} begins {1e-9 * (then[0] - before[1]):.0f} s after the end of {path}: "
            "if they are two drives, pass --separate"
            for (before, path), (then, after) in pairwise(known)
            if then[0] - before[1] > _LONG_PAUSE_NS
        ]

    def messages(self, topics: Collection[str], steered_by: str) -> Iterator[Message]:
        """Yield the messages of some topics in the order of the recording.

        If the times of the topic `steered_by` step back within a ROS 1 bag, the bag is read in the order of writing. By
        time, different parts of the drive would be mixed.
        """
        streams = [_stream(source, topics, steered_by, self._cut) for source in self._sources]
        yield from merge(*streams, key=lambda message: message.bag_time) if len(streams) > 1 else streams[0]

    def close(self) -> None:
        """Close the files, which stay open between passes; another pass opens them again."""
        for source in self._sources:
            source.close()

    def damages(self) -> list[str]:
        """Return one line for each damaged file."""
        return [line for source in self._sources for line in source.damages()]

    def notes(self) -> list[str]:
        """Return one line for each file with a write-ahead log."""
        return [line for source in self._sources for line in source.notes()]

    def losses(self, topic: str) -> list[Loss]:
        """Return the losses of a topic by damage, as far as known."""
        return [loss for source in self._sources for loss in source.losses(topic)]

    def _add(self, connection: BagConnection) -> None:
        """Add a connection's messages to its topic."""
        known = self.topics.get(connection.topic)
        count = connection.msgcount + (known.messages if known else 0)
        self.topics[connection.topic] = Topic(connection.topic, connection.msgtype, count)


def _decoders() -> tuple[MessageDecoder, MessageDecoder]:
    """Return the decoders of ROS 2 and of ROS 1, by `BagConnection.is_ros1`: an MCAP file may hold both."""
    return MessageDecoder(is_ros1=False), MessageDecoder(is_ros1=True)


def _stream(source: BagSource, topics: Collection[str], steered_by: str, cut: CloudSlice | None) -> Iterator[Message]:
    _check_definitions(source.path, [each for each in source.connections if each.topic in topics and each.is_ros1])
    decoders = _decoders()
    for connection, time, data in source.messages(topics, steered_by):
        content = decoders[connection.is_ros1].decoded(connection.msgtype, data)
        if isinstance(content, PointCloud):
            content = None if cut is None else FramedScan(content.frame, cut.scan(content))
        yield Message(connection.topic, connection.msgtype, 1e-9 * time, content)


def _check_definitions(path: Path, connections: list[BagConnection]) -> None:
    """Refuse a message type that has the name of a standard type but another definition."""
    for connection in connections:
        standard = standard_md5_sum(connection.msgtype)
        # A name may be damaged, too: nothing of it will be decoded.
        if standard is not None and connection.digest not in (standard, "*", ""):
            raise DatasetError(
                f"{path}: {connection.topic} is no standard {connection.msgtype} (checksum {connection.digest}, "
                f"not {standard}): migrate the bag with `rosbag fix`, or choose another topic"
            )
