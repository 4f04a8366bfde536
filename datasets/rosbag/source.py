"""Raw messages of a bag: read by rosbags if it is intact, otherwise salvaged from the damaged file."""

import logging
import struct
import weakref
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags import rosbag1

from datasets.errors import DatasetError
from datasets.rosbag.bag_files import (
    CutFileError,
    UnpackedFile,
    check_files,
    is_ros1,
    log_of,
    storage_files,
    unpacked,
)
from datasets.rosbag.indexed_messages import IndexedMessages, RawMessage, plain
from datasets.rosbag.write_ahead_log import with_log
from datasets.salvage.salvaged_bag import BagAnnouncement, Loss, SalvagedBag, announced_by
from tbmslam.special_file import why_unreadable

if TYPE_CHECKING:
    from rosbags import rosbag2

logger = logging.getLogger(__name__)


class OpenBag:
    """A bag file or ROS 2 bag with its index in memory; reading a large index takes seconds.

    The file is closed at the latest when the object is collected. `connections` are its topics, and `span` the times of
    its first and its last message [ns].
    """

    def __init__(self, path: Path, is_ros1: bool) -> None:
        self._reader = _opened(path, is_ros1)
        self._finalizer = weakref.finalize(self, self._reader.close)
        self._indexed = IndexedMessages(self._reader) if isinstance(self._reader, rosbag1.Reader) else None
        self.connections = [plain(connection) for connection in self._reader.connections]
        self.span = self._reader.start_time, self._reader.end_time

    def close(self) -> None:
        """Close the file, if it is not closed already."""
        self._finalizer()

    def messages(self, topics: Collection[str], steered_by: str) -> Iterator[RawMessage]:
        """Yield messages of some topics by time; a bag of ROS 1 by place where the times of `steered_by` step back.

        One pass at a time.
        """
        reader = self._reader
        connections = [connection for connection in reader.connections if connection.topic in topics]
        if not connections:  # for rosbags, no connection means all connections
            return
        if self._indexed is None:
            known = {connection.id: plain(connection) for connection in connections}
            for connection, time, data in reader.messages(connections):
                yield RawMessage(known[connection.id], time, data)
        elif self._indexed.steps_back(connections, steered_by):
            logger.info("%s: times of %s step back, reading in the order of writing", reader.path, steered_by)
            yield from self._indexed.in_order_of_writing(connections)
        else:
            yield from self._indexed.by_time(connections)


def _opened(path: Path, is_ros1: bool) -> "rosbag1.Reader | rosbag2.Reader":
    if is_ros1:
        reader = rosbag1.Reader(path)
        reader.open()
        return reader
    from rosbags import rosbag2  # noqa: PLC0415 - slow to load, and a bag of ROS 1 does not need it

    newer = rosbag2.Reader(path)
    newer.open()
    return newer


class BagSource:
    """A bag file or ROS 2 bag that stays open between passes until it is closed. A file may be packed as a whole."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: str | None = None
        self.span: tuple[int, int] | None = None
        """Times of the first and the last message [ns]; None where damage leaves them unknown."""
        self._salvaged: SalvagedBag | None = None
        self._parts: list[BagSource] = []
        self._idle: OpenBag | None = None
        self._announced = BagAnnouncement()
        if why := why_unreadable(path):
            raise DatasetError(f"{path}: {why}: give a recording's file or folder")
        try:
            content = unpacked(path)
            self._file, self._note = with_log(content.path)
            self.is_ros1 = is_ros1(self._file)
        except OSError as error:
            raise DatasetError(f"{path}: cannot be read: {error.strerror}: check its permissions") from error
        try:
            _check(content._replace(path=self._file))
            if _is_indexed(self._file):
                self._idle = OpenBag(self._file, self.is_ros1)
                self.connections, self.span = self._idle.connections, self._idle.span
            else:
                self._read_through()
        except Exception as error:  # noqa: BLE001 - rosbags raises anything on damaged files
            self._salvage(error)

    def messages(self, topics: Collection[str], steered_by: str) -> Iterator[RawMessage]:
        """Yield messages of some topics by time.

        If the times of `steered_by` step back within a ROS 1 bag, that bag is read in the order of writing: by time,
        different parts of the drive would be mixed. If damage is found only now, the bag is salvaged, and reading
        continues after the messages that were already yielded.
        """
        given: Counter[str] = Counter()
        if self.damage is None and self._salvaged is None and not self._parts:
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
        """Return the known losses of a topic."""
        if self._salvaged is not None:
            return self._salvaged.losses(topic)
        losses = [loss for part in self._parts for loss in part.losses(topic)]
        found = sum(connection.msgcount for connection in self.connections if connection.topic == topic)
        more = self._announced.loss(topic, found + sum(loss.messages for loss in losses))
        return losses if more is None else [*losses, more]

    def damages(self) -> list[str]:
        """Return one line for each damaged file."""
        of_parts = [line for part in self._parts for line in part.damages()]
        is_listed = self.damage is None or any(f": {self.damage}" in line for line in of_parts)
        own = [f"{self.path}: {self.damage}"] if self.damage and not is_listed else []
        return [*own, *of_parts]

    def notes(self) -> list[str]:
        """Return one line for each file with a write-ahead log, which is no damage."""
        own = [f"{self.path}: {self._note}"] if self._note else []
        return [*own, *(line for part in self._parts for line in part.notes())]

    def close(self) -> None:
        """Close the files; another pass opens them again."""
        bag, self._idle = self._idle, None
        if bag is not None:
            bag.close()
        for part in self._parts:
            part.close()

    def _sound(self, topics: Collection[str], steered_by: str) -> Iterator[RawMessage]:
        """Yield messages through rosbags."""
        bag, self._idle = self._idle or OpenBag(self._file, self.is_ros1), None
        try:
            yield from bag.messages(topics, steered_by)
        finally:
            if self._idle is None:
                self._idle = bag
            else:  # there were two passes at a time
                bag.close()

    def _rescued(self, topics: Collection[str], steered_by: str) -> Iterator[RawMessage]:
        """Yield the salvaged messages."""
        for part in self._parts:
            yield from part.messages(topics, steered_by)
        if self._salvaged is not None:
            connections = [connection for connection in self._salvaged.connections if connection.topic in topics]
            written = self._salvaged.times(steered_by)
            by_time = not self.is_ros1 or bool((written[1:] >= written[:-1]).all())
            for connection, time, data in self._salvaged.messages(connections, by_time=by_time):
                yield RawMessage(connection, time, data)

    def _read_through(self) -> None:
        """Read files one by one: databases with logs, and MCAP files whose index leaves messages out, as it may."""
        if self.path.is_dir():
            self._parts = [BagSource(path) for path in storage_files(self.path)]
            self._announced = announced_by(self.path)
            self.connections = [connection for part in self._parts for connection in part.connections]
            spans = [part.span for part in self._parts]
        else:
            from datasets.salvage.mcap_file import salvage_mcap  # noqa: PLC0415 - needed rarely

            found = salvage_mcap(self._file, "")
            if found.reason or found.holes:
                raise CutFileError("the file is cut off or damaged, and its index is not complete")
            self._salvaged, self.connections = found, found.connections
            times = found.entries[:, 0]
            spans = [(int(times.min()), int(times.max()))] if len(times) else []
        known = [span for span in spans if span is not None]
        self.span = (min(first for first, _ in known), max(last for _, last in known)) if known else None

    def _salvage(self, error: Exception) -> None:
        """Read the messages without the index."""
        self.close()
        self.damage = _explained(self._file, error)
        if not _may_be_salvaged(self._file, error):
            raise DatasetError(f"{self.path}: {self.damage}") from error
        if self.path.is_dir():
            self._parts = _salvaged_parts(self.path, self.damage)
            self._announced = announced_by(self.path)
            self.connections = [connection for part in self._parts for connection in part.connections]
        else:
            self._salvaged = _salvaged_file(self._file, self.path, self.damage)
            self.damage = self._salvaged.reason
            self.connections = self._salvaged.connections
        if not any(connection.msgcount for connection in self.connections):
            raise DatasetError(f"{self.path}: {self.damage}; no message in it can be read: fetch it again") from error
        logger.debug("%s: salvaged after %r", self.path, error)


def _check(content: UnpackedFile) -> None:
    """Refuse damage that rosbags might not notice."""
    if content.damage is not None:
        raise CutFileError(content.damage)
    check_files(content.path)  # sqlite reads zeros where a file is cut off


def _is_indexed(path: Path) -> bool:
    """Return whether rosbags finds all messages or raises an error; else a file's index or the file is incomplete."""
    storage = storage_files(path) if path.is_dir() else [path]
    if path.is_dir() and any(map(log_of, storage)):
        return False
    files = [file for file in storage if file.suffix == ".mcap"]
    if not files:
        return True
    from datasets.salvage.mcap_file import has_full_index  # noqa: PLC0415 - other files do not need it

    try:
        return all(map(has_full_index, files))
    except Exception:  # noqa: BLE001 - mcap raises anything on damaged files
        return True


def _salvaged_file(file: Path, path: Path, damage: str) -> SalvagedBag:
    """Salvage a file of any format; `path` is its name in messages."""
    # Salvagers are needed rarely.
    from datasets.salvage.mcap_file import salvage_mcap  # noqa: PLC0415
    from datasets.salvage.ros1 import salvage_ros1  # noqa: PLC0415
    from datasets.salvage.sqlite_file import salvage_sqlite  # noqa: PLC0415

    try:
        if is_ros1(file):
            return salvage_ros1(file, damage)
        return salvage_mcap(file, damage) if file.suffix == ".mcap" else salvage_sqlite(file, damage)
    except (OSError, ValueError, ArithmeticError, LookupError, struct.error) as error:  # an empty file cannot be mapped
        raise DatasetError(f"{path}: {damage}; and no part of it can be read ({error}): fetch it again") from error


def _salvaged_parts(folder: Path, damage: str) -> list[BagSource]:
    """Return the readable storage files of a directory."""
    files = storage_files(folder)
    if not files:
        raise DatasetError(
            f"{folder}: {damage}, and the folder holds no storage file (.db3, .mcap): copy it there, or decompress it"
        )
    parts = []
    for path in files:
        try:
            parts.append(BagSource(path))
        except DatasetError as error:
            logger.warning("%s", error)
    return parts


def _may_be_salvaged(path: Path, error: Exception) -> bool:
    """Return whether the content of a file causes the error, and its format is known."""
    if isinstance(error, DatasetError | FileNotFoundError | PermissionError):
        return path.is_dir() and isinstance(error, FileNotFoundError)
    return not path.is_file() or not is_ros1(path) or _version(path).startswith("#ROSBAG V2.0")


def _version(path: Path) -> str:
    """Return the first line of a ROS 1 bag."""
    with path.open("rb") as stream:
        return stream.readline(40).decode("ascii", "replace").strip()


def _explained(path: Path, error: Exception) -> str:
    """Return the fault in one line."""
    text = " ".join(str(error).split())
    if path.is_dir() and not (path / "metadata.yaml").exists():
        return "no metadata.yaml in this directory"
    if path.is_dir() and (missing := announced_by(path).missing_files(path)):
        return f"its storage {', '.join(missing[:5])} is missing"
    if isinstance(error, FileNotFoundError | PermissionError):
        return f"cannot be read: {error.strerror or 'No such file or directory'}"
    if isinstance(error, CutFileError):
        return text
    if is_ros1(path):
        return _explained_ros1(path, error, text)
    return f"the bag is damaged ({type(error).__name__}: {text[:200]})"


def _explained_ros1(path: Path, error: Exception, text: str) -> str:
    """Return the fault of a ROS 1 bag in one line."""
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
