"""Finds and opens recordings: detects the kind of their files, chooses the reader, and computes their SHA-256."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from datasets.errors import DatasetError
from datasets.options import RecordingOptions
from datasets.recording import Recording
from datasets.rosbag.bag_files import STORAGE_SUFFIXES, log_of
from datasets.text_files import first_bytes
from tbmslam.special_file import is_device_or_pipe, sha256_of, why_unreadable

_STORAGE_STARTS = {b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}
_BAG_STARTS = (b"#ROSBAG", b"#ROSRECORD", *_STORAGE_STARTS)
_ROS_SUFFIXES = (".bag", ".db3", ".mcap")


def open_recording(paths: Sequence[Path], options: RecordingOptions | None = None) -> Recording:
    """Open one recording that lies in one or several files.

    Parameters
    ----------
    paths
        ROS 1 bags, ROS 2 bags (directory or storage file) or CARMEN logs, all of one family; several are one
        recording: bags are merged by time, logs are read one after another.
    options
        Choices that replace automatic ones.

    Raises
    ------
    DatasetError
        A path is missing, damaged, of unknown kind, or does not hold what the options ask for.
    """
    if not paths:
        raise ValueError("paths must name at least one file, got none")
    files = [Path(path) for path in paths]
    kinds = {path: _kind(path) for path in files}
    if len(set(kinds.values())) > 1:
        listed = ", ".join(f"{path} ({kind})" for path, kind in kinds.items())
        raise DatasetError(f"{listed}: bags and logs cannot be one recording: give them separately")
    chosen = options or RecordingOptions()
    if kinds[files[0]] == "carmen":
        from datasets.carmen import open_carmen  # noqa: PLC0415 - each format loads only what it needs

        return open_carmen(files, chosen)
    from datasets.rosbag.reader import open_rosbags  # noqa: PLC0415 - rosbags takes long to import

    return open_rosbags(files, chosen)


def _kind(path: Path) -> str:
    """Return "rosbag" or "carmen" by the content of a file; a file of ROS 2 must also have the suffix of its format."""
    if path.is_dir():
        return _kind_of_directory(path)
    if why := why_unreadable(path):
        raise DatasetError(f"{path}: {why}: give a recording's file or folder")
    try:
        with path.open("rb") as stream:
            head = stream.read(4096)
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file or directory: check the path") from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}: check its permissions") from error
    if head.startswith(_BAG_STARTS):
        _check_suffix(path, head)
        return "rosbag"
    if path.suffix in _ROS_SUFFIXES:
        raise DatasetError(f"{path}: does not begin like a {path.suffix} file: it is damaged or not a recording")
    head = first_bytes(path)
    if head.startswith(_BAG_STARTS):
        _check_suffix(path, head, packed=path.suffix)
        return "rosbag"
    if b"rosbag2_bagfile_information:" in head:
        raise DatasetError(f"{path}: describes a ROS 2 bag: give its folder, {path.parent}")
    if b"\0" in head:
        raise DatasetError(f"{path}: is neither a ROS bag nor a CARMEN log: give a laser recording")
    return "carmen"


def _check_suffix(path: Path, head: bytes, packed: str = "") -> None:
    """Refuse a storage file of ROS 2 with another suffix, by which rosbags would choose the wrong reader."""
    for start, suffix in _STORAGE_STARTS.items():
        if head.startswith(start) and not path.name.endswith(suffix + packed):
            raise DatasetError(f"{path}: is a {suffix} file of another name: rename it to end in {suffix}{packed}")


def _kind_of_directory(path: Path) -> str:
    """Accept a directory that is a ROS 2 bag."""
    names = sorted(entry.name for entry in path.iterdir())
    of_bag = [path / name for name in names if name == "metadata.yaml" or name.endswith((*STORAGE_SUFFIXES, ".zstd"))]
    for file in of_bag:
        if is_device_or_pipe(file):
            raise DatasetError(f"{file}: is a device or a pipe: give the recording's own file")
    storage = [file for file in of_bag if file.name != "metadata.yaml"]
    if storage and all(map(why_unreadable, storage)):
        raise DatasetError(f"{storage[0]}: is empty: copy the recording again")
    if of_bag:
        return "rosbag"
    bags = [name for name in names if name.endswith(".bag")]
    if bags:
        raise DatasetError(f"{path}: a directory of ROS 1 bags; give the files themselves: {', '.join(bags[:5])}")
    raise DatasetError(
        f"{path}: a directory without a ROS 2 bag (metadata.yaml, .db3 or .mcap): give a recording's file or folder"
    )


_FILES = (".bag", ".db3", ".mcap", ".log", ".clf")
_PACKED = (".gz", ".bz2", ".xz")
_ROS_2 = (".db3", ".mcap", ".zstd")
_LOGS = (".db3-wal", ".db3-shm")  # of a recorder that was interrupted


def list_recordings(paths: Iterable[Path]) -> list[Path]:
    """Return recordings with those in directories, by name, in the place of the directories.

    A ROS 2 bag is itself a directory. Other directories in a directory are ignored. Raises a `DatasetError` if a
    directory holds no recording or cannot be read, or if a path leads to a device or a pipe.
    """
    return [found for path in paths for found in _recordings_at(path)]


def _recordings_at(path: Path) -> list[Path]:
    if is_device_or_pipe(path):
        raise DatasetError(f"{path}: is a device or a pipe: give a recording's file or folder")
    if not path.is_dir() or _is_ros2_bag(path):
        return [path]
    found = [entry for entry in _entries(path) if (_is_ros2_bag(entry) if entry.is_dir() else _is_recording(entry))]
    if not found:
        raise DatasetError(
            f"{path}: a directory without recordings (.bag, .mcap, .db3, .log, .clf): give another directory"
        )
    return found


def _is_ros2_bag(directory: Path) -> bool:
    """Return whether a directory is a ROS 2 bag: it has its description, or only storage files."""
    names = [entry.name for entry in _entries(directory) if not entry.name.endswith(_LOGS)]
    return "metadata.yaml" in names or (bool(names) and all(name.endswith(_ROS_2) for name in names))


def _is_recording(file: Path) -> bool:
    if is_device_or_pipe(file):
        return False
    name = file.name.lower()
    for ending in _PACKED:
        name = name.removesuffix(ending)
    return name.endswith(_FILES) and not name.startswith(".")


def _entries(directory: Path) -> list[Path]:
    try:
        return sorted(directory.iterdir())
    except OSError as error:
        raise DatasetError(f"{directory}: cannot be read: {error.strerror}: check its permissions") from error


def file_digests(paths: Iterable[Path]) -> list[dict[str, str | int]]:
    """Return name, size and SHA-256 of each file, also of those in directories and of logs beside databases.

    Raises a `DatasetError` if a file cannot be read.
    """
    return [_digest(file) for path in paths for file in _files(path)]


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        return sorted(entry for entry in path.rglob("*") if entry.is_file())
    log = log_of(path)
    return [path] if log is None else [path, log]


def _digest(file: Path) -> dict[str, str | int]:
    try:
        if is_device_or_pipe(file):
            raise DatasetError(f"{file}: is a device or a pipe: give a recording's file or folder")
        return {"name": file.name, "bytes": file.stat().st_size, "sha256": sha256_of(file)}
    except FileNotFoundError:
        raise DatasetError(f"{file}: no such file or directory: check the path") from None
    except OSError as error:
        raise DatasetError(f"{file}: cannot be read: {error.strerror}: check its permissions") from error
