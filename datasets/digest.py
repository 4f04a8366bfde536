"""What a recording's files are, whatever they are called and wherever they lie."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

from datasets.errors import DatasetError
from tbmslam.special_file import is_device_or_pipe


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
            raise DatasetError(f"{file}: is no file but a device or a pipe: give a recording's file or folder")
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
