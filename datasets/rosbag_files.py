"""Bag files as one stream of decoded messages; everything that rosbags can raise becomes a `DatasetError` here."""

import logging
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from heapq import merge
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from datasets.errors import DatasetError

logger = logging.getLogger(__name__)

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
POSE_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
_KEPT_CHUNKS = 6
_REINDEX = "let `rosbag reindex` repair a copy, or fetch the file again"


class Topic(NamedTuple):
    """One topic of a recording."""

    name: str
    msgtype: str
    messages: int


class Message(NamedTuple):
    """One decoded message; None where its bytes cannot be decoded."""

    topic: str
    msgtype: str
    bag_time: float
    content: Any


class BagFiles:
    """One or several bag files, ROS 1 or ROS 2, read as one recording.

    Messages are decoded by the standard definitions of their types, not by those the bag carries, so that a definition
    that cannot be parsed, in whichever topic, does no harm, and bags without definitions (ROS 2 Humble) need none.

    Parameters
    ----------
    paths
        ROS 1 bag files; ROS 2 bag directories or storage files.

    Raises
    ------
    DatasetError
        A file is damaged or of a version that cannot be read.
    """

    def __init__(self, paths: list[Path]) -> None:
        self.paths = paths
        self.topics: dict[str, Topic] = {}
        with self._opened() as readers:
            for reader in readers:
                for connection in reader.connections:
                    self._add(connection)

    def of_type(self, *msgtypes: str) -> list[Topic]:
        """Return the topics of some message types, sorted by name."""
        return sorted(topic for topic in self.topics.values() if topic.msgtype in msgtypes)

    def messages(self, topics: Collection[str], steered_by: str) -> Iterator[Message]:
        """Yield the messages of some topics in the order of the recording.

        Parameters
        ----------
        topics
            Names of the topics.
        steered_by
            Where the times of this topic step back within a ROS 1 bag, that bag is read in the order of its writing
            rather than by time, which would weave different parts of the drive into each other.

        Raises
        ------
        DatasetError
            The file is damaged.
        """
        with self._opened() as readers:
            streams = [_stream(reader, topics, steered_by) for reader in readers]
            yield from merge(*streams, key=lambda message: message.bag_time) if len(streams) > 1 else streams[0]

    def _add(self, connection: Connection) -> None:
        """Add a connection's messages to its topic."""
        known = self.topics.get(connection.topic)
        count = connection.msgcount + (known.messages if known else 0)
        self.topics[connection.topic] = Topic(connection.topic, connection.msgtype, count)

    @contextmanager
    def _opened(self) -> Iterator[list[rosbag1.Reader | rosbag2.Reader]]:
        """Open all files, and close them whatever happens."""
        with ExitStack() as stack:
            readers = []
            for path in self.paths:
                with _translated(path):
                    reader: rosbag1.Reader | rosbag2.Reader
                    reader = rosbag1.Reader(path) if _is_ros1(path) else rosbag2.Reader(_storage_of(path))
                    reader.open()
                    if isinstance(reader, rosbag1.Reader):
                        _keep_chunks(reader)
                stack.callback(reader.close)
                readers.append(reader)
            yield readers


def _stream(reader: rosbag1.Reader | rosbag2.Reader, topics: Collection[str], steered_by: str) -> Iterator[Message]:
    """Yield the decoded messages of one file."""
    connections = [connection for connection in reader.connections if connection.topic in topics]
    if not connections:
        return
    path = Path(str(reader.path))
    store = _standard_types(isinstance(reader, rosbag1.Reader))
    decode = store.deserialize_ros1 if isinstance(reader, rosbag1.Reader) else store.deserialize_cdr
    with _translated(path):
        if isinstance(reader, rosbag1.Reader):
            _check_definitions(path, store, connections)
            connections = _in_order_of_writing(reader, connections, steered_by)
        for connection, nanoseconds, raw in reader.messages(connections):
            try:
                content = decode(raw, connection.msgtype)
            except Exception as error:  # noqa: BLE001 - rosbags raises anything on damaged bytes
                logger.debug("%s: a message of %s cannot be decoded: %r", path, connection.topic, error)
                content = None
            yield Message(connection.topic, connection.msgtype, 1e-9 * nanoseconds, content)


def _keep_chunks(reader: rosbag1.Reader) -> None:
    """Let a reader remember the last chunks it decompressed.

    Where topics lie in chunks of their own, reading by time jumps between these, and rosbags keeps only one.
    """
    remembered = {chunk.decompressor: lru_cache(_KEPT_CHUNKS)(chunk.decompressor) for chunk in reader.chunks.values()}
    reader.chunks = {
        place: chunk._replace(decompressor=remembered[chunk.decompressor]) for place, chunk in reader.chunks.items()
    }


def _in_order_of_writing(reader: rosbag1.Reader, connections: list[Connection], steered_by: str) -> list[Connection]:
    """Let a reader yield messages in the order of writing where the times of the steering topic step back.

    rosbags yields by time. Its index knows where each message lies in the file: given as one list, that order is kept.
    """
    steps_back = 0
    for connection in connections:
        if connection.topic == steered_by:
            places = [entry[1:] for entry in reader.indexes[connection.id]]
            steps_back += sum(later < earlier for earlier, later in pairwise(places))
    if not steps_back:
        return connections
    logger.info("%s: times of %s step back, read in the order of writing", reader.path, steered_by)
    entries = [entry for connection in connections for entry in reader.indexes[connection.id]]
    reader.indexes[connections[0].id] = sorted(entries, key=lambda entry: (entry[1], entry[2]))
    return connections[:1]


def _standard_types(is_ros1: bool) -> Typestore:
    """Return the standard message definitions, with both names of the tf message."""
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name in TF_TYPES:
        if name not in store.fielddefs:
            store.register(get_types_from_msg(_TF_DEFINITION, name))
    return store


def _check_definitions(path: Path, store: Typestore, connections: list[Connection]) -> None:
    """Refuse a message type that only bears the name of a standard one."""
    for connection in connections:
        standard = store.generate_msgdef(connection.msgtype)[1]
        if connection.digest not in (standard, "*", ""):
            raise DatasetError(
                f"{path}: {connection.topic} is no standard {connection.msgtype} (checksum {connection.digest}, "
                f"not {standard}): migrate the bag with `rosbag fix`, or choose another topic"
            )


def _is_ros1(path: Path) -> bool:
    """Return whether a file is a ROS 1 bag."""
    if path.is_dir():
        return False
    with path.open("rb") as stream:
        return stream.read(4) == b"#ROS"


def _storage_of(path: Path) -> Path:
    """Return what rosbags can open: a directory with metadata, or the one storage file in a directory without."""
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return path
    files = sorted(entry for entry in path.iterdir() if entry.suffix in (".db3", ".mcap"))
    if len(files) != 1:
        names = ", ".join(entry.name for entry in files) or "only compressed files"
        raise DatasetError(f"{path}: no metadata.yaml in this directory; give its storage files themselves ({names})")
    return files[0]


@contextmanager
def _translated(path: Path) -> Iterator[None]:
    """Turn whatever rosbags raises into one line about this file."""
    try:
        yield
    except DatasetError:
        raise
    except Exception as error:
        raise DatasetError(f"{path}: {_explained(path, error)}") from error


def _explained(path: Path, error: Exception) -> str:
    """Say in one line what is wrong and what can be done."""
    text = " ".join(str(error).split())
    if not path.is_dir() and _is_ros1(path):
        with path.open("rb") as stream:
            version = stream.readline(40).decode("ascii", "replace").strip()
        if not version.startswith("#ROSBAG V2.0"):
            return f"a bag of version {version.lstrip('#')!r}, only V2.0 can be read: convert it with `rosbag fix`"
        if "not indexed" in text:
            return f"the bag has no index, its recorder was interrupted: {_REINDEX}"
        if "index looks damaged" in text:
            return f"the bag is cut off or its index is damaged: {_REINDEX}"
        if isinstance(error, AssertionError):
            return f"the index of the bag contradicts itself: {_REINDEX}"
    if isinstance(error, OSError) and error.strerror:
        return f"cannot be read: {error.strerror}"
    return f"the bag is damaged ({type(error).__name__}: {text[:200]}): fetch it again or repair a copy"
