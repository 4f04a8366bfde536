"""A map as a folder: map.npz with all data, pictures, and files for other programs."""

import os
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from tbmslam.belief.grid import TbmGrid
from tbmslam.io.beesoft_map import read_beesoft_map
from tbmslam.io.map_npz import drive_lengths, read_map_file, write_map_file
from tbmslam.io.pictures import PICTURE_NAMES, write_pictures
from tbmslam.io.ros_map import read_ros_map, read_ros_map_header, write_ros_map
from tbmslam.io.tbm_dump import read_tbm_dump
from tbmslam.io.trajectory_file import write_tum
from tbmslam.map.map_check import MapFileError
from tbmslam.map.tbm_map import TbmMap

_GRID_READERS: dict[tuple[str, ...], Callable[[Path], TbmGrid]] = {
    (".yaml", ".yml"): read_ros_map,
    (".tbm_map", ".tbm_map.xz"): read_tbm_dump,
    (".dat", ".dat.gz"): read_beesoft_map,
}
_PICTURES = (".pgm", ".png", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg")
_RECORDINGS = (".bag", ".mcap", ".db3", ".log", ".clf")
_LONGEST_NAME = 100
FIXED_NAMES = ("map.npz", "map.yaml", "map.pgm", *(f"{name}.png" for name in PICTURE_NAMES), "pignistic.pgw")
"""Files of all map folders, besides trajectories."""


def save_map(folder: str | os.PathLike[str], tbm_map: TbmMap) -> None:
    """Write a map to a folder: map.npz, map.yaml and map.pgm, trajectories, pictures.

    Each file is written whole or not at all. A single drive is trajectory.tum, several are trajectory_NAME.tum. The
    trajectories of an older map in the folder are removed first. So even after an interruption, no trajectory lies
    beside a map of other drives.

    Raises
    ------
    TypeError
        If it is no map; a merge of maps that do not fit together has none.
    ValueError
        If the map has no cells, or its provenance holds what JSON cannot.
    FileNotWrittenError
        If the folder or a file cannot be written.
    """
    if not isinstance(tbm_map, TbmMap):
        none = ": nothing was merged; print the merge for the reasons" if tbm_map is None else ""
        raise TypeError(f"tbm_map must be a TbmMap, got {type(tbm_map).__name__}{none}")
    if not tbm_map.grid.geometry.rows * tbm_map.grid.geometry.cols:
        raise ValueError(f"tbm_map must have cells, got {tbm_map.grid.geometry}")
    folder = Path(folder)
    older = _trajectories_in(folder)
    write_map_file(folder / "map.npz", tbm_map, lambda: _remove(folder / name for name in older))
    write_ros_map(folder / "map.yaml", tbm_map.grid)
    lengths = [(drive.name, len(drive.trajectory)) for drive in tbm_map.drives]
    for name, number in _trajectory_files(lengths).items():
        write_tum(folder / name, tbm_map.drives[number].trajectory)
    write_pictures(folder, tbm_map.grid)


def map_files(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the files in a folder with names of files of `save_map`."""
    names = (*FIXED_NAMES, *sorted(_trajectories_in(Path(folder))))
    return [Path(folder, name) for name in names if os.path.lexists(Path(folder, name))]


def remove_map(folder: str | os.PathLike[str]) -> None:
    """Remove the files that `save_map` wrote into a folder; other files stay."""
    # The file with the names of the trajectories is removed last.
    _remove(reversed(map_files(folder)))


def load_map(path: str | os.PathLike[str]) -> TbmMap:
    """Read a map of any supported format.

    Parameters
    ----------
    path
        A folder that `save_map` wrote (or one with a map.yaml), a .npz of ours, the .yaml of a ROS map, a .tbm_map of
        the original programs, or the .dat of a Beesoft map.

    Raises
    ------
    MapFileError
        There is no map of a supported format, or it is damaged.
    """
    path = Path(path)
    if path.is_dir():
        path = _map_in(path)
    if not path.exists():
        raise MapFileError(f"{path}: does not exist: give a map's folder or file")
    name = path.name.lower()
    if name.endswith(".npz"):
        return read_map_file(path)
    for endings, read_grid in _GRID_READERS.items():
        if name.endswith(endings):
            return TbmMap(read_grid(path), provenance={"read_from": path.name})
    if name.endswith(_PICTURES):
        raise MapFileError(f"{path}: is a picture without the size of a cell: give its yaml file")
    if name.endswith(_RECORDINGS):
        raise MapFileError(
            f"{path}: is a recording: map its scans with `tbmslam map`, or convert its OccupancyGrid with "
            "`tbmslam convert`"
        )
    raise MapFileError(f"{path}: has an unknown format: give a folder, or a .npz, .yaml, .tbm_map or .dat file")


def _map_in(folder: Path) -> Path:
    for name in ("map.npz", "map.yaml"):
        if (folder / name).is_file():
            return folder / name
    raise MapFileError(
        f"{folder}: holds no map.npz or map.yaml: give a folder that `tbmslam map` or `merge` wrote, or a map's file"
    )


def files_of_map(path: str | os.PathLike[str]) -> list[Path]:
    """Return the files that `load_map` reads."""
    path = _map_in(Path(path)) if Path(path).is_dir() else Path(path)
    is_yaml = path.name.lower().endswith((".yaml", ".yml")) and path.is_file()
    return [path, read_ros_map_header(path).image] if is_yaml else [path]


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)


def _trajectories_in(folder: Path) -> set[str]:
    """Return the names of the map's trajectories in a folder, which may contain others."""
    return set(_trajectory_files(drive_lengths(folder / "map.npz"))) if (folder / "map.npz").is_file() else set()


def _trajectory_files(lengths: Sequence[tuple[str, int]]) -> dict[str, int]:
    """Return file names of drives with the index of their drive, from names and poses.

    A drive without poses gets none, since evo reads no empty file.
    """
    files: dict[str, int] = {}
    taken = set()
    for number, (drive, length) in enumerate(lengths):
        if not length:
            continue
        plain = re.sub(r"[^\w.-]+", "_", drive)[:_LONGEST_NAME]
        stem = name = "trajectory" if len(lengths) == 1 else f"trajectory_{plain}"
        repeated = 1
        # Names may differ only in characters that file names cannot contain, or in case, which some disks ignore.
        while name.lower() in taken:
            repeated += 1
            name = f"{stem}_{repeated}"
        taken.add(name.lower())
        files[f"{name}.tum"] = number
    return files
