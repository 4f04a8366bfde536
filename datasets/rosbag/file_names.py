"""Which files make a bag, and of which kind they are."""

import re
from pathlib import Path

from tbmslam.special_file import why_unreadable

STORAGE_SUFFIXES = (".db3", ".mcap")


def is_ros1(path: Path) -> bool:
    """Return whether a file is a ROS 1 bag."""
    if path.is_dir():
        return False
    with path.open("rb") as stream:
        return stream.read(4) == b"#ROS"


def storage_files(folder: Path) -> list[Path]:
    """Return the storage files of a ROS 2 bag's directory as they were written: number 10 comes after number 9."""
    files = [entry for entry in folder.iterdir() if entry.suffix in STORAGE_SUFFIXES]
    return sorted(files, key=lambda file: [int(part) if part.isdigit() else part for part in _parts(file.name)])


class CutFileError(ValueError):
    """A file of a bag ends too soon."""


def check_files(path: Path) -> None:
    """Refuse a database that is shorter than it says: sqlite would read zeros where its last page is cut off.

    And what passes for an empty file, since reading it might never end.

    Parameters
    ----------
    path
        A bag's file or directory.

    Raises
    ------
    CutFileError
        It is, or one of those in the directory.
    """
    for file in [path / "metadata.yaml", *storage_files(path)] if path.is_dir() else [path]:
        if why := why_unreadable(file):
            raise CutFileError(f"{file.name} {why}")
        if not file.is_file():
            continue
        with file.open("rb") as stream:
            head = stream.read(100)
        if not head.startswith(b"SQLite format 3\0") or head[24:28] != head[92:96]:  # an older sqlite states no size
            continue
        page = int.from_bytes(head[16:18], "big")
        stated = int.from_bytes(head[28:32], "big") * (65536 if page == 1 else page)
        size = file.stat().st_size
        if size < stated:
            raise CutFileError(f"the database is cut off, {size} of {stated} bytes are there")


def _parts(name: str) -> list[str]:
    """Return a name's numbers and what lies between them, beginning with the latter."""
    return re.split(r"(\d+)", name)
