"""Which files make a bag, and of which kind they are."""

import re
from pathlib import Path

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


def _parts(name: str) -> list[str]:
    """Return a name's numbers and what lies between them, beginning with the latter."""
    return re.split(r"(\d+)", name)
