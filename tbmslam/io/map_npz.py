"""A whole map in one file, `map.npz`: numpy arrays in a zip, none of them pickled.

==========================  ==========================================================================
``format_version``          1
``geometry``                resolution, origin_x, origin_y [m] (3,) float64
``masses``                  (rows, cols, 4) float32: conflict, free, occupied, unknown
``provenance``              JSON text
``drives``                  names (D,); the arrays of drive K are named as follows
``drive_K_stamps``          (N,) float64 [s]; ``drive_K_poses`` (N, 3) float64
``drive_K_keyframes_X``     the arrays of `Keyframes`, X being the name of the field; older files have neither
                            beam_steps nor indices
``drive_K_closures``        (C, 2) int64 keyframes between which loops were closed; older files have none
``drive_K_motions_X``       the arrays of `DriveMotions`; older files, and drives of which none were kept, have none
==========================  ==========================================================================

The same map gives the same bytes.
"""

import dataclasses
import json
import os
from bisect import bisect_left
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, Masses, TbmGrid
from tbmslam.geometry.se2 import FloatArray
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.npz import Array, ArrayZip, NpzError, write_npz
from tbmslam.map.drive import Drive, DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.map_check import MapFileError, check_file, check_geometry, stray_number
from tbmslam.map.tbm_map import TbmMap
from tbmslam.special_file import why_unreadable

FORMAT_VERSION = 1
_KEYFRAME_DTYPES = {"offsets": np.int64, "ranges": np.float32, "indices": np.int64}  # all others are float64
_MISSING_IN_OLDER = frozenset({"beam_steps", "indices"})
_KEYFRAME_NAMES = tuple(field.name for field in dataclasses.fields(Keyframes))


def write_map_file(path: str | os.PathLike[str], tbm_map: TbmMap, make_way: Callable[[], object] | None = None) -> None:
    """Write a map atomically; see `tbmslam.io.atomic_file.replacing`.

    Raises
    ------
    ValueError
        If the masses are no beliefs or the provenance is not JSON.
    """
    if (fault := tbm_map.grid.fault()) is not None:
        raise ValueError(f"tbm_map must hold beliefs: {fault}")
    try:
        provenance = json.dumps(dict(tbm_map.provenance))
    except TypeError as error:
        raise ValueError(f"provenance must be JSON: {error}") from None
    write_npz(path, _arrays(tbm_map, provenance), make_way)


def _arrays(tbm_map: TbmMap, provenance: str) -> dict[str, Array]:
    geometry = tbm_map.grid.geometry
    arrays: dict[str, Array] = {
        "format_version": np.array(FORMAT_VERSION, dtype=np.int64),
        "geometry": np.array([geometry.resolution, geometry.origin_x, geometry.origin_y], dtype=np.float64),
        "masses": tbm_map.grid.masses.astype(np.float32, copy=False),
        "provenance": np.array(provenance),
        "drives": np.array([drive.name for drive in tbm_map.drives], dtype=np.str_),
    }
    for number, drive in enumerate(tbm_map.drives):
        arrays[f"drive_{number}_stamps"] = drive.trajectory.stamps.astype(np.float64, copy=False)
        arrays[f"drive_{number}_poses"] = drive.trajectory.poses.astype(np.float64, copy=False)
        for name in _KEYFRAME_NAMES:
            values: Array = getattr(drive.keyframes, name)
            dtype = _KEYFRAME_DTYPES.get(name, np.float64)
            arrays[f"drive_{number}_keyframes_{name}"] = values.astype(dtype, copy=False)
        arrays[f"drive_{number}_closures"] = drive.closures.astype(np.int64, copy=False)
        if drive.motions is not None:
            arrays[f"drive_{number}_motions_steps"] = drive.motions.steps.astype(np.float64, copy=False)
            arrays[f"drive_{number}_motions_informations"] = drive.motions.informations.astype(np.float64, copy=False)
    return arrays


def read_map_file(path: str | os.PathLike[str]) -> TbmMap:
    """Read a map. All contents are checked, and none is executed.

    Raises
    ------
    MapFileError
        The file is no map of this format, damaged, or of a newer version.
    """
    try:
        check_file(path)
        with Path(path).open("rb"):
            pass
    except OSError as error:
        raise MapFileError(
            f"{path}: cannot be read ({error.strerror}): check its permissions, or give another file"
        ) from error
    try:
        with ArrayZip(path) as arrays:
            _require_version(path, arrays)
            grid = _read_grid(path, arrays)
            drives = tuple(
                _read_drive(arrays, number, str(name), grid.geometry)
                for number, name in enumerate(arrays.read("drives", np.str_, (None,)))
            )
            return TbmMap(grid, drives, _read_provenance(arrays))
    # ValueError: the types refuse arrays that do not belong together; RecursionError: provenance of brackets.
    except (NpzError, ValueError, RecursionError) as error:
        raise MapFileError(f"{path}: is not a map of tbmslam, or is damaged: {error}: build the map again") from error


def drive_lengths(path: str | os.PathLike[str]) -> list[tuple[str, int]]:
    """Return the names of a map's drives and their numbers of poses; empty if the file is no map."""
    try:
        if why_unreadable(Path(path)):
            return []
        with ArrayZip(path) as arrays:
            names = arrays.read("drives", np.str_, (None,)).tolist()
            sizes = [arrays.shape(f"drive_{number}_stamps", np.float64, (None,))[0] for number in range(len(names))]
    except (NpzError, OSError, ValueError):
        return []
    return list(zip(names, sizes, strict=True))


def _require_version(path: str | os.PathLike[str], arrays: ArrayZip) -> None:
    version = int(arrays.read("format_version", np.int64, ()))
    if version != FORMAT_VERSION:
        raise MapFileError(
            f"{path}: is a map of format {version}, and this program reads format {FORMAT_VERSION}: update the program"
        )


def _read_grid(path: str | os.PathLike[str], arrays: ArrayZip) -> TbmGrid:
    rows, cols, _ = arrays.shape("masses", np.float32, (None, None, 4))
    resolution, origin_x, origin_y = arrays.read("geometry", np.float64, (3,)).tolist()
    geometry = GridGeometry(resolution, origin_x, origin_y, rows, cols)
    check_geometry(path, geometry)
    grid = TbmGrid(geometry, cast("Masses", arrays.read("masses", np.float32, (rows, cols, 4))))
    if (fault := grid.fault()) is not None:
        raise ValueError(fault)
    return grid


def _read_drive(arrays: ArrayZip, number: int, name: str, geometry: GridGeometry) -> Drive:
    stamps = arrays.read(f"drive_{number}_stamps", np.float64, (None,))
    poses = arrays.read(f"drive_{number}_poses", np.float64, (len(stamps), 3))
    keyframes = {
        field: arrays.read(
            f"drive_{number}_keyframes_{field}",
            _KEYFRAME_DTYPES.get(field, np.float64),
            (None, None) if field in {"poses", "sensor_poses", "beams", "beam_steps"} else (None,),
        )
        for field in _KEYFRAME_NAMES
        if field not in _MISSING_IN_OLDER or f"drive_{number}_keyframes_{field}" in arrays
    }
    keyframes.setdefault("beam_steps", np.zeros((len(keyframes["stamps"]), 3)))
    if "indices" not in keyframes:
        keyframes["indices"] = indices_by_stamp(Trajectory(stamps, poses), keyframes["stamps"], keyframes["poses"])
    found, closures = Keyframes(**keyframes), f"drive_{number}_closures"
    between = arrays.read(closures, np.int64, (None, 2)) if closures in arrays else np.zeros((0, 2), dtype=np.int64)
    drive = Drive(name, Trajectory(stamps, poses), found, between, _read_motions(arrays, number))
    if (stray := stray_number(drive, geometry)) is not None:
        raise ValueError(stray)
    return drive


def _read_motions(arrays: ArrayZip, number: int) -> DriveMotions | None:
    steps, informations = (f"drive_{number}_motions_{name}" for name in ("steps", "informations"))
    if steps not in arrays:
        return None
    return DriveMotions(arrays.read(steps, np.float64, (None, 3)), arrays.read(informations, np.float64, (None, 3, 3)))


def _read_provenance(arrays: ArrayZip) -> Mapping[str, object]:
    provenance = json.loads(str(arrays.read("provenance", np.str_, ())))
    if not isinstance(provenance, dict):
        raise ValueError("provenance is no JSON object")  # noqa: TRY004  # an error of the file, not of the caller
    return provenance


_SAME_POSE = 1e-6
"""Largest difference of equal poses [m, rad]."""

_MOST_COMPARED = 100
"""Number of poses with one stamp that are compared with a keyframe; all have one stamp if the clock stands still."""


def indices_by_stamp(trajectory: Trajectory, stamps: FloatArray, poses: FloatArray) -> npt.NDArray[np.int64]:
    """Return the index (K,) of each keyframe in the trajectory, in the order of the drive as stamps may step back.

    A keyframe is the next pose after the keyframe before it that has its stamp. Where several have it, it is the first
    of them that lies where the keyframe does; where none does, the first. Where none has its stamp, it is the pose at
    which stamps come nearest to it before they move away again. Without a trajectory keyframes are merely counted.

    Parameters
    ----------
    trajectory
        All poses (N, 3) of the drive and their stamps.
    stamps, poses
        Stamps (K,) [s] and poses (K, 3) of the keyframes, in the order of the drive.

    Raises
    ------
    ValueError
        If there are more keyframes than poses.
    """
    count, length = len(stamps), len(trajectory)
    if not length:
        return np.arange(count)
    if count > length:
        raise ValueError(f"{count} keyframes cannot be among the {length} poses of the trajectory")
    having: dict[float, list[int]] = {}
    for index, stamp in enumerate(trajectory.stamps.tolist()):
        having.setdefault(stamp, []).append(index)
    found, previous = np.empty(count, dtype=np.int64), -1
    for number, stamp in enumerate(stamps.tolist()):
        last = length - count + number  # enough poses remain for the later keyframes
        same = having.get(stamp, [])
        first = bisect_left(same, previous + 1)
        coming = [index for index in same[first : first + _MOST_COMPARED] if index <= last]
        if coming:
            apart = np.abs(trajectory.poses[coming] - poses[number]).max(axis=1)
            previous = coming[int(np.argmax(apart < _SAME_POSE))]  # the first pose if none is near
        else:
            previous = _nearest_coming(trajectory.stamps, stamp, previous + 1, last)
        found[number] = previous
    return found


def _nearest_coming(stamps: FloatArray, stamp: float, first: int, last: int) -> int:
    """Return the first index of a range, ends included, after which the stamps move away from the given stamp."""
    while first < last and abs(stamps[first + 1] - stamp) < abs(stamps[first] - stamp):
        first += 1
    return first
