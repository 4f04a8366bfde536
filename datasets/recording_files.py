"""The files of recordings: their listing in a directory, and their SHA-256."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

from datasets.errors import DatasetError
from tbmslam.special_file import is_device_or_pipe

_FILES = (".bag", ".db3", ".mcap", ".log", ".clf")
_PACKED = (".gz", ".bz2", ".xz")
_ROS_2 = (".db3", ".mcap", ".zstd")


def list_recordings(paths: Iterable[Path]) -> list[Path]:
    """Return recordings with those in directories, by name, in the place of the directories.

    A ROS 2 bag is a directory too and stays one; directories in directories are not entered but where they are such
    bags.

    Raises
    ------
    DatasetError
        A directory holds no recording, or cannot be read; a path leads to a device or a pipe.
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
    names = [entry.name for entry in _entries(directory)]
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
        raise DatasetError(f"{directory}: cannot be read: {error.strerror}") from error


def file_digests(paths: Iterable[Path]) -> list[dict[str, str | int]]:
    """Return name, size and SHA-256 of each file; a directory stands for the files in it.

    Raises
    ------
    DatasetError
        A file is missing or cannot be read.
    """
    return [_digest(file) for path in paths for file in _files(path)]


def _files(path: Path) -> list[Path]:
    return sorted(entry for entry in path.rglob("*") if entry.is_file()) if path.is_dir() else [path]


def _digest(file: Path) -> dict[str, str | int]:
    try:
        if is_device_or_pipe(file):
            raise DatasetError(f"{file}: is a device or a pipe: give a recording's file or folder")
        size = file.stat().st_size
        if not size:  # what passes for empty may have no end
            return {"name": file.name, "bytes": 0, "sha256": hashlib.sha256().hexdigest()}
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256")
        return {"name": file.name, "bytes": size, "sha256": digest.hexdigest()}
    except FileNotFoundError:
        raise DatasetError(f"{file}: no such file or directory") from None
    except OSError as error:
        raise DatasetError(f"{file}: cannot be read: {error.strerror}") from error
