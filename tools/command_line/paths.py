"""Paths on the command line: files and folders, and lists of maps."""

import argparse
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from tbmslam.errors import TbmSlamError


def check_exist(paths: Iterable[Path | None], fact: str = "no such file or directory: check the path") -> None:
    """Check that files or folders exist, before libraries are loaded; None is an option that was not given."""
    for path in paths:
        try:
            if path is not None:
                path.lstat()
        except (FileNotFoundError, NotADirectoryError):
            raise TbmSlamError(f"{path}: {fact}") from None
        except OSError:
            continue  # its reader reports other errors


def refuse_to_overwrite(read: Iterable[Path], written: Iterable[Path]) -> None:
    """Refuse to write a file that is read, under whatever name."""
    taken = {os.path.realpath(path) for path in written}
    for path in read:
        if os.path.realpath(path) in taken:
            raise TbmSlamError(f"{path}: is read and would be overwritten: choose another folder or name")


def path_argument(text: str) -> Path:
    """Return the path of a word of the command line, for the `type` of an argument."""
    if not text:
        raise argparse.ArgumentTypeError("the name of a file is empty: is a variable of the shell unset?")
    return Path(text)


_MAPS = ("map.npz", "map.yaml")
_BESIDE_MAPS = ("report.html", "truth.json")
"""Files that `tbmslam map` writes beside the folders of its maps."""


def list_maps(paths: Iterable[Path]) -> list[Path]:
    """Return maps; a folder without a map is replaced by the map folders in it: robot_0, robot_1, ...

    Files that `tbmslam map` writes beside these folders are left out, since the shell names them for `out/*`, too.
    """
    return [
        found
        for path in paths
        if not (path.name in _BESIDE_MAPS and path.is_file())
        for found in (map_folders(path) if path.is_dir() and not holds_map(path) else []) or [path]
    ]


def map_folders(path: Path) -> list[Path]:
    """Return the map folders in a folder: robot_0, robot_1, ..., robot_10."""
    return sorted((entry for entry in path.iterdir() if entry.is_dir() and holds_map(entry)), key=_by_number)


def holds_map(folder: Path) -> bool:
    """Return whether a folder contains a map."""
    return any((folder / name).is_file() for name in _MAPS)


def _by_number(folder: Path) -> list[str | tuple[int, str]]:
    """Return a sort key that puts robot_10 after robot_9."""
    return [(int(part), part) if index % 2 else part for index, part in enumerate(re.split(r"(\d+)", folder.name))]


def unique_names(paths: Sequence[Path]) -> list[str]:
    """Return unique names of maps: their folder or file, with parts of the path where needed."""
    parts = [_naming_parts(path) for path in paths]
    depth, names = 1, [own[-1] for own in parts]
    while len(set(names)) < len(set(parts)):
        depth += 1
        names = ["/".join(own[-depth:]) for own in parts]
    # Paths that are still equal are one map.
    return [
        name if names[:index].count(name) == 0 else f"{name}#{names[:index].count(name) + 1}"
        for index, name in enumerate(names)
    ]


def _naming_parts(path: Path) -> tuple[str, ...]:
    """Return the parts of a path that identify its map: `robot_0/map.npz` is robot_0."""
    try:
        full = path.resolve()
    except RuntimeError:  # circular links; loading reports the error
        full = path.absolute()
    if full.suffix and not full.is_dir():
        full = full.parent if full.stem == "map" else full.with_suffix("")
    return full.parts[1:] or (str(path),)
