"""Paths that lead to what is no file and no folder."""

from pathlib import Path


def is_device_or_pipe(path: Path) -> bool:
    """Tell whether something stands there that is neither a file nor a folder: reading it might never end.

    Of a link, what it leads to counts; where nothing stands there is no device either.

    Raises
    ------
    OSError
        If a folder on the way may not be entered.
    """
    return path.exists() and not (path.is_file() or path.is_dir())
