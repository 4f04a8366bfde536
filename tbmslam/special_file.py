"""Paths of devices and pipes, which are neither files nor folders."""

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
