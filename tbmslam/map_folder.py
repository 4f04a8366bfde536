"""A map as a folder: everything in map.npz, and the same for people and other programs beside it."""

import os
import re
from pathlib import Path

from tbmslam.map_check import MapFileError
from tbmslam.map_file import read_map_file, write_map_file
from tbmslam.map_pictures import write_pictures
from tbmslam.ros_map import read_ros_map, write_ros_map
from tbmslam.tbm_map import Drive, TbmMap
from tbmslam.tum import write_tum


def save_map(folder: str | os.PathLike[str], tbm_map: TbmMap) -> None:
    """Write a map's folder, made if need be: map.npz, map.yaml and map.pgm, trajectories, pictures.

    A single drive is trajectory.tum, several are trajectory_NAME.tum; trajectories of an older map there are removed.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    trajectories = _trajectory_names(tbm_map.drives)
    for old in folder.glob("trajectory*.tum"):
        if old.name not in trajectories:
            old.unlink()
    write_map_file(folder / "map.npz", tbm_map)
    write_ros_map(folder / "map", tbm_map.grid)
    for name, drive in trajectories.items():
        write_tum(folder / name, drive.trajectory)
    write_pictures(folder, tbm_map.grid)


def _trajectory_names(drives: tuple[Drive, ...]) -> dict[str, Drive]:
    """Return the trajectories' file names; a drive without poses gets none, since evo reads no empty file."""
    if len(drives) == 1 and len(drives[0].trajectory):
        return {"trajectory.tum": drives[0]}
    names: dict[str, Drive] = {}
    for number, drive in enumerate(drives):
        if not len(drive.trajectory):
            continue
        plain = re.sub(r"[^\w.-]+", "_", drive.name)
        # Names that differ only in what a file name cannot hold, or in case, would overwrite each other.
        taken = {name.lower() for name in names}
        name = f"trajectory_{plain}.tum"
        names[f"trajectory_{plain}_{number}.tum" if name.lower() in taken else name] = drive
    return names


def load_map(path: str | os.PathLike[str]) -> TbmMap:
    """Read a map: a folder that `save_map` wrote, a map.npz, or the yaml file of a ROS map.

    Raises
    ------
    MapFileError
        There is no map of a format known here, or it is damaged.
    """
    path = Path(path)
    if path.is_dir():
        path = _map_in(path)
    if not path.exists():
        raise MapFileError(f"{path}: does not exist: give a map's folder or file")
    name = path.name.lower()
    if name.endswith(".npz"):
        return read_map_file(path)
    if name.endswith((".yaml", ".yml")):
        return TbmMap(read_ros_map(path), provenance={"read_from": path.name})
    raise MapFileError(f"{path}: is no map this reads: give a folder, .npz or .yaml")


def _map_in(folder: Path) -> Path:
    if not (folder / "map.npz").is_file():
        raise MapFileError(
            f"{folder}: holds no map.npz: give a folder that build_maps or merge wrote, or a map's yaml file"
        )
    return folder / "map.npz"
