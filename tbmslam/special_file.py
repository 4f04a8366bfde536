"""Checks for devices, pipes and empty files, whose content cannot be read; and digests of files."""

import hashlib
from pathlib import Path


def is_device_or_pipe(path: Path) -> bool:
    """Return whether a path is neither a file nor a folder; reading it might never end.

    Links are followed. A path that does not exist is no device. Raises an `OSError` if a folder of the path is not
    accessible.
    """
    return path.exists() and not (path.is_file() or path.is_dir())


def why_unreadable(path: Path) -> str | None:
    """Return the reason why a file cannot be read, as the end of a sentence; None if it may be readable.

    Some files of the system, such as /proc/kmsg, appear empty, and reading them might never end. Raises an `OSError` if
    a folder of the path is not accessible.
    """
    if is_device_or_pipe(path):
        return "is a device or a pipe"
    return "is empty" if path.is_file() and path.stat().st_size == 0 else None


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal; a file that appears empty is not read, since it may have no end."""
    if not path.stat().st_size:
        return hashlib.sha256().hexdigest()
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
