"""Maps that lie in a folder, as build_maps leaves them."""

import re
from collections.abc import Iterable
from pathlib import Path

_MAPS = ("map.npz", "map.yaml")


def list_maps(paths: Iterable[Path]) -> list[Path]:
    """Return maps, and in the place of a folder that is none the map folders in it: robot_0, robot_1, ..."""
    return [found for path in paths for found in (_maps_in(path) or [path])]


def _maps_in(path: Path) -> list[Path]:
    if not path.is_dir() or holds_map(path):
        return []
    return sorted((entry for entry in path.iterdir() if entry.is_dir() and holds_map(entry)), key=_by_number)


def holds_map(folder: Path) -> bool:
    """Tell whether a folder is a map's."""
    return any((folder / name).is_file() for name in _MAPS)


def _by_number(folder: Path) -> list[str | tuple[int, str]]:
    """Return a key under which robot_10 comes after robot_9."""
    return [(int(part), part) if index % 2 else part for index, part in enumerate(re.split(r"(\d+)", folder.name))]
