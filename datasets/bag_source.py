"""One bag as raw messages: through rosbags where it is sound, salvaged where it is not."""

import logging
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection

from datasets.bag_files import is_ros1, storage_files
from datasets.errors import DatasetError
from datasets.salvaged_bag import BagConnection, Loss, SalvagedBag

logger = logging.getLogger(__name__)

_KEPT_CHUNKS = 6


class RawMessage(NamedTuple):
    """One message as it lies in the bag."""

    connection: BagConnection
    time: int
    data: bytes


class BagSource:
    """A bag file or ROS 2 directory.

    Parameters
    ----------
    path
        ROS 1 bag file; ROS 2 bag directory or storage file.

    Raises
    ------
    DatasetError
        It is of a version that cannot be read, or nothing of it can.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: str | None = None
        self._salvaged: SalvagedBag | None = None
        self._parts: list[BagSource] = []
        try:
            self.is_ros1 = is_ros1(path)
        except OSError as error:
            raise DatasetError(f"{path}: cannot be read: {error.strerror}") from error
        try:
            with self._opened() as reader:
                self.connections = [_plain(connection) for connection in reader.connections]
        except Exception as error:  # noqa: BLE001 - rosbags raises anything on damaged files
            self._salvage(error)

    def messages(self, topics: Collection[str], steered_by: str) -> Iterator[RawMessage]:
        """Yield messages of some topics by time.

        Where the times of `steered_by` step back within a ROS 1 bag, that bag is read in the order of its writing,
        since times would weave different parts of the drive into each other. Damage that shows only now is salvaged,
        too, and reading goes on behind what was yielded already.
        """
        given: Counter[str] = Counter()
        if self.damage is None:
            try:
                for message in self._sound(topics, steered_by):
                    yield message
                    given[message.connection.topic] += 1
            except Exception as error:  # noqa: BLE001 - rosbags raises anything on damaged bytes
                self._salvage(error)
            else:
                return
        for message in self._rescued(topics, steered_by):
            if given[message.connection.topic]:
                given[message.connection.topic] -= 1
            else:
                yield message

    def losses(self, topic: str) -> list[Loss]:
        """Return what is known to be missing of a topic."""
        if self._salvaged is not None:
            return self._salvaged.losses(topic)
        return [loss for part in self._parts for loss in part.losses(topic)]

    def damages(self) -> list[str]:
        """Return one line for each damaged file."""
        own = [f"{self.path}: {self.damage}"] if self.damage is not None else []
        return own + [line for part in self._parts for line in part.damages()]

    def _sound(self, topics: Collection[str], steered_by: str) -> Iterator[RawMessage]:
        """Yield messages through rosbags."""
        with self._opened() as reader:
            connections = [connection for connection in reader.connections if connection.topic in topics]
            if not connections:
                return
            plain = {connection.id: _plain(connection) for connection in connections}
            if isinstance(reader, rosbag1.Reader):
                connections = _in_order_of_writing(reader, connections, steered_by)
            for connection, time, data in reader.messages(connections):
                yield RawMessage(plain[connection.id], time, data)

    def _rescued(self, topics: Collection[str], steered_by: str) -> Iterator[RawMessage]:
        """Yield what was salvaged."""
        for part in self._parts:
            yield from part.messages(topics, steered_by)
        if self._salvaged is not None:
            connections = [connection for connection in self._salvaged.connections if connection.topic in topics]
            written = self._salvaged.times(steered_by)
            by_time = not self.is_ros1 or bool((written[1:] >= written[:-1]).all())
            for connection, time, data in self._salvaged.messages(connections, by_time=by_time):
                yield RawMessage(connection, time, data)

    @contextmanager
    def _opened(self) -> Iterator[rosbag1.Reader | rosbag2.Reader]:
        """Open through rosbags, and close whatever happens."""
        with rosbag1.Reader(self.path) if self.is_ros1 else rosbag2.Reader(self.path) as reader:
            if isinstance(reader, rosbag1.Reader):
                _keep_chunks(reader)
            yield reader

    def _salvage(self, error: Exception) -> None:
        """Find what can be read without the index."""
        self.damage = _explained(self.path, error)
        if not _may_be_salvaged(self.path, error):
            raise DatasetError(f"{self.path}: {self.damage}") from error
        if self.path.is_dir():
            self._parts = _salvaged_parts(self.path, self.damage)
            self.connections = [connection for part in self._parts for connection in part.connections]
        else:
            self._salvaged = _salvaged_file(self.path, self.damage)
            self.damage = self._salvaged.reason
            self.connections = self._salvaged.connections
        if not any(connection.msgcount for connection in self.connections):
            raise DatasetError(f"{self.path}: {self.damage}; no message in it can be read: fetch it again") from error
        logger.debug("%s: salvaged after %r", self.path, error)


def _salvaged_file(path: Path, damage: str) -> SalvagedBag:
    """Salvage a file of whichever format."""
    # A salvager is needed rarely.
    from datasets.mcap_salvage import salvage_mcap  # noqa: PLC0415
    from datasets.ros1_salvage import salvage_ros1  # noqa: PLC0415
    from datasets.sqlite_salvage import salvage_sqlite  # noqa: PLC0415

    try:
        if is_ros1(path):
            return salvage_ros1(path, damage)
        return salvage_mcap(path, damage) if path.suffix == ".mcap" else salvage_sqlite(path, damage)
    except (OSError, ValueError, struct.error) as error:  # an empty file cannot be mapped
        raise DatasetError(f"{path}: {damage}; and nothing of it can be read ({error}): fetch it again") from error


def _salvaged_parts(folder: Path, damage: str) -> list[BagSource]:
    """Return the readable storage files of a directory."""
    files = storage_files(folder)
    if not files:
        raise DatasetError(f"{folder}: {damage}, and no storage file (.db3, .mcap); decompress what is compressed")
    parts = []
    for path in files:
        try:
            parts.append(BagSource(path))
        except DatasetError as error:
            logger.warning("%s", error)
    return parts


def _plain(connection: Connection) -> BagConnection:
    """Return what is needed of a connection after its reader is closed."""
    return BagConnection(connection.id, connection.topic, connection.msgtype, connection.digest, connection.msgcount)


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


def _may_be_salvaged(path: Path, error: Exception) -> bool:
    """Return whether the content is to blame, and of a format that is known."""
    if isinstance(error, DatasetError | FileNotFoundError | PermissionError):
        return path.is_dir() and isinstance(error, FileNotFoundError)
    return not path.is_file() or not is_ros1(path) or _version(path).startswith("#ROSBAG V2.0")


def _version(path: Path) -> str:
    """Return the first line of a ROS 1 bag."""
    with path.open("rb") as stream:
        return stream.readline(40).decode("ascii", "replace").strip()


def _explained(path: Path, error: Exception) -> str:
    """Say in one line what is wrong."""
    text = " ".join(str(error).split())
    if path.is_dir() and not (path / "metadata.yaml").exists():
        return "no metadata.yaml in this directory"
    if isinstance(error, FileNotFoundError):
        return "cannot be read: No such file or directory"
    if isinstance(error, PermissionError):
        return f"cannot be read: {error.strerror}"
    if is_ros1(path):
        return _explained_ros1(path, error, text)
    return f"the bag is damaged ({type(error).__name__}: {text[:200]})"


def _explained_ros1(path: Path, error: Exception, text: str) -> str:
    """Say in one line what is wrong with a ROS 1 bag."""
    version = _version(path)
    if not version.startswith("#ROSBAG V2.0"):
        return f"a bag of version {version.lstrip('#')!r}, only V2.0 can be read: convert it with `rosbag fix`"
    if "not indexed" in text:
        return "the bag has no index, its recorder was interrupted"
    if "index looks damaged" in text:
        return "the bag is cut off or its index is damaged"
    if isinstance(error, AssertionError):
        return "the index of the bag contradicts itself"
    return f"the bag is damaged ({type(error).__name__}: {text[:200]})"
