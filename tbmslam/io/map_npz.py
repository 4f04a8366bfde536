"""A whole map in one file, `map.npz`: numpy arrays in a zip, none of them pickled.

==========================  ==========================================================================
``format_version``          1
``geometry``                resolution, origin_x, origin_y [m] (3,) float64
``masses``                  (rows, cols, 4) float32: conflict, free, occupied, unknown
``provenance``              JSON text
``drives``                  names (D,); the arrays of drive K are named as follows
``drive_K_stamps``          (N,) float64 [s]; ``drive_K_poses`` (N, 3) float64
``drive_K_keyframes_X``     the arrays of `Keyframes`, X being the name of the field
``drive_K_closures``        (C, 2) int64 keyframes between which loops were closed
``drive_K_motions_X``       the arrays of `DriveMotions` between successive keyframes, if the drive has any
``drive_K_closure_motions_X``  the same of the closures; older files have none
``links_ends``, ``links_X``    the arrays of `DriveLinks`, if there are any
==========================  ==========================================================================

The same map gives the same bytes. Every array is checked when it is read.
"""

import dataclasses
import json
import math
import os
import struct
import sys
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self, cast

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import Masses
from tbmslam.belief.tiled_masses import SIDE, TiledMasses
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import replacing
from tbmslam.map.drive import Drive, DriveLinks, DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.map_check import MapFileError, check_file, check_geometry, stray_number
from tbmslam.map.tbm_map import TbmMap
from tbmslam.special_file import why_unreadable

Array = npt.NDArray[Any]
_DEFLATE_LIMIT = 1040  # largest compression ratio of deflate; a file with a larger ratio states wrong sizes

_FREE_BYTES, _USUAL_RATIO = 64_000_000, 100
"""Size above which an array of unknown length with a better compression than the numbers of a drive is refused."""

_LONGEST_REASON = 120


class NpzError(TbmSlamError):
    """A file is not a zip of the expected arrays."""


def write_npz(
    path: str | os.PathLike[str], arrays: Mapping[str, Array | TbmGrid], make_way: Callable[[], object] | None = None
) -> None:
    """Write named arrays atomically in the given order for `numpy.load`; see `replacing`.

    A grid is written as the array of its masses, a band of rows at a time. An array of Python objects is a
    `ValueError`.
    """
    try:
        with (
            replacing(path, make_way) as temporary,
            zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        ):
            for name, values in arrays.items():
                # An entry that is opened by its name gets the zip epoch as its time, so equal arrays give equal bytes.
                with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                    if isinstance(values, TbmGrid):
                        _write_masses(stream, values)
                    else:
                        np.lib.format.write_array(stream, values, allow_pickle=False)
    except ValueError as error:
        # An archive that is interrupted at the end of an entry cannot be closed; the error would hide the interruption.
        if isinstance(error.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise


_BAND = SIDE
"""Rows of masses that are written or read at once, to limit the memory."""


def _write_masses(stream: IO[bytes], grid: TbmGrid) -> None:
    header = {"descr": "<f4", "fortran_order": False, "shape": (grid.geometry.rows, grid.geometry.cols, 4)}
    np.lib.format.write_array_header_1_0(stream, header)
    for first in range(0, grid.geometry.rows, _BAND):
        rows = grid.masses_of_rows(first, min(first + _BAND, grid.geometry.rows))
        stream.write(np.ascontiguousarray(rows, dtype="<f4").data)


class ArrayZip:
    """A file of named arrays, opened for reading.

    Raises an `NpzError` if the file cannot be read or is no zip.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        try:
            self._archive = zipfile.ZipFile(path)
        except OSError as error:
            raise NpzError(f"it cannot be read ({error.strerror or error})") from error
        except (zipfile.BadZipFile, NotImplementedError, ValueError, struct.error) as error:
            raise NpzError(f"it is no zip file ({_shortened(error)})") from error

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Close the file."""
        self._archive.close()

    def __contains__(self, name: str) -> bool:
        """Return whether the file has an array of this name."""
        return f"{name}.npy" in self._archive.namelist()

    def shape(self, name: str, dtype: npt.DTypeLike, shape: tuple[int | None, ...]) -> tuple[int, ...]:
        """Return the shape of an array from its header, after checks without reading it; None is any length.

        Raises an `NpzError` if the array is missing, of another type or shape, or its size is not that of its data.
        """
        with self._entry(name) as (stream, info):
            return _checked_shape(stream, info, name, dtype, shape)

    def read(self, name: str, dtype: npt.DTypeLike, shape: tuple[int | None, ...]) -> Array:
        """Return an array; see `shape` for the arguments and errors.

        Implausibly large arrays are refused if the expected shape has an open size.
        """
        self.shape(name, dtype, shape)
        with self._entry(name) as (stream, info):
            if None in shape or np.dtype(dtype).kind == "U":
                _check_ratio(name, info)
            values = np.lib.format.read_array(stream, allow_pickle=False)
            stream.read(1)  # the checksum is compared at the end of an entry
            # numpy accepts strings with invalid code points, on which Python fails later.
            if values.dtype.kind == "U" and np.any(np.frombuffer(values.tobytes(), dtype=np.uint32) > sys.maxunicode):
                raise NpzError(f"{name} is damaged text")
            return np.ascontiguousarray(values).reshape(values.shape)

    def masses(self, name: str, rows: int, cols: int) -> TiledMasses:
        """Return masses (rows, cols, 4), which are read a band of rows at a time; see `shape` for the errors."""
        tiled = TiledMasses(rows, cols)
        self.shape(name, np.float32, (rows, cols, 4))
        with self._entry(name) as (stream, _):
            np.lib.format.read_magic(stream)
            _, by_columns, _ = np.lib.format.read_array_header_1_0(stream)
            if by_columns:
                return TiledMasses.of(cast("Masses", self.read(name, np.float32, (rows, cols, 4))))
            for first in range(0, rows, _BAND):
                count = min(_BAND, rows - first)
                band = np.frombuffer(stream.read(count * cols * 16), dtype=np.float32)
                tiled.put_rows(first, band.reshape(count, cols, 4))
            stream.read(1)  # the checksum is compared at the end of an entry
        return tiled

    @contextmanager
    def _entry(self, name: str) -> Iterator[tuple[IO[bytes], zipfile.ZipInfo]]:
        """Open the bytes of an array; every error while they are read is an NpzError."""
        try:
            info = self._archive.getinfo(f"{name}.npy")
            with self._archive.open(info) as stream:
                yield stream, info
        except KeyError:
            raise NpzError(f"it has no {name}") from None
        except NpzError:
            raise
        # Damaged zips and headers raise many types, also tokenize.TokenError and SystemError.
        except Exception as error:
            raise NpzError(f"{name} cannot be read ({_shortened(error)})") from error


def _check_ratio(name: str, info: zipfile.ZipInfo) -> None:
    if info.file_size > _FREE_BYTES + _USUAL_RATIO * info.compress_size:
        raise NpzError(f"{name} would unpack from {info.compress_size} to {info.file_size} bytes, like a zip bomb")


def _shortened(error: Exception) -> str:
    """Return the shortened text of an error, since libraries may quote the rest of the file."""
    return " ".join(str(error).split())[:_LONGEST_REASON]


def _checked_shape(
    stream: IO[bytes], info: zipfile.ZipInfo, name: str, dtype: npt.DTypeLike, shape: tuple[int | None, ...]
) -> tuple[int, ...]:
    if info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        raise NpzError(f"{name} has a compression that numpy does not use")
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise NpzError(f"{name} has a header of version {version}, not 1.0")
    found_shape, _, found_dtype = np.lib.format.read_array_header_1_0(stream)
    expected = np.dtype(dtype)
    # The length of texts is free.
    if found_dtype != expected and (found_dtype.kind != "U" or expected.kind != "U" or not found_dtype.isnative):
        raise NpzError(f"{name} is of type {found_dtype}, not {expected}")
    agrees = len(found_shape) == len(shape) and all(
        wanted in {None, found} for found, wanted in zip(found_shape, shape, strict=True)
    )
    if not agrees:
        wanted = " x ".join("any" if length is None else str(length) for length in shape)
        raise NpzError(f"{name} has shape {found_shape}, not {wanted or 'that of a single value'}")
    size = stream.tell() + math.prod(found_shape) * found_dtype.itemsize
    if size != info.file_size or size > _DEFLATE_LIMIT * (info.compress_size + 64):
        raise NpzError(f"{name} states {size} bytes but does not hold them")
    return found_shape


FORMAT_VERSION = 1
_KEYFRAME_DTYPES = {"offsets": np.int64, "ranges": np.float32, "indices": np.int64}  # all others are float64
_MOTION_KINDS = ("motions", "closure_motions")
_KEYFRAME_NAMES = tuple(field.name for field in dataclasses.fields(Keyframes))


def write_map_file(path: str | os.PathLike[str], tbm_map: TbmMap, make_way: Callable[[], object] | None = None) -> None:
    """Write a map atomically; see `tbmslam.io.atomic_file.replacing`.

    Raises a `ValueError` if the masses are no beliefs or the provenance is not JSON.
    """
    if (fault := tbm_map.grid.fault()) is not None:
        raise ValueError(f"tbm_map must hold beliefs: {fault}")
    try:
        provenance = json.dumps(dict(tbm_map.provenance))
    except TypeError as error:
        raise ValueError(f"provenance must be JSON: {error}") from None
    write_npz(path, _arrays(tbm_map, provenance), make_way)


def _arrays(tbm_map: TbmMap, provenance: str) -> dict[str, Array | TbmGrid]:
    geometry = tbm_map.grid.geometry
    arrays: dict[str, Array | TbmGrid] = {
        "format_version": np.array(FORMAT_VERSION, dtype=np.int64),
        "geometry": np.array([geometry.resolution, geometry.origin_x, geometry.origin_y], dtype=np.float64),
        "masses": tbm_map.grid,
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
        for kind in _MOTION_KINDS:
            motions: DriveMotions | None = getattr(drive, kind)
            if motions is not None:
                arrays[f"drive_{number}_{kind}_steps"] = motions.steps.astype(np.float64, copy=False)
                arrays[f"drive_{number}_{kind}_informations"] = motions.informations.astype(np.float64, copy=False)
    if tbm_map.links is not None:
        arrays["links_ends"] = tbm_map.links.ends.astype(np.int64, copy=False)
        arrays["links_steps"] = tbm_map.links.motions.steps.astype(np.float64, copy=False)
        arrays["links_informations"] = tbm_map.links.motions.informations.astype(np.float64, copy=False)
    return arrays


def read_map_file(path: str | os.PathLike[str]) -> TbmMap:
    """Read a map. All contents are checked, and none is executed.

    Raises a `MapFileError` if the file is no map of this format, damaged, or of a newer version.
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
            motions = _read_motions(arrays, "links")
            links = None if motions is None else DriveLinks(arrays.read("links_ends", np.int64, (None, 4)), motions)
            return TbmMap(grid, drives, _read_provenance(arrays), links)
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


def is_merged_map(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a map that a merge made, by its provenance."""
    try:
        if why_unreadable(Path(path)):
            return False
        with ArrayZip(path) as arrays:
            return "merged_from" in _read_provenance(arrays)
    except (NpzError, OSError, ValueError, RecursionError):
        return False


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
    grid = TbmGrid(geometry, arrays.masses("masses", rows, cols))
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
    }
    closures = arrays.read(f"drive_{number}_closures", np.int64, (None, 2))
    motions = {kind: _read_motions(arrays, f"drive_{number}_{kind}") for kind in _MOTION_KINDS}
    drive = Drive(name, Trajectory(stamps, poses), Keyframes(**keyframes), closures, **motions)
    if (stray := stray_number(drive, geometry)) is not None:
        raise ValueError(stray)
    return drive


def _read_motions(arrays: ArrayZip, prefix: str) -> DriveMotions | None:
    steps, informations = f"{prefix}_steps", f"{prefix}_informations"
    if steps not in arrays:
        return None
    return DriveMotions(arrays.read(steps, np.float64, (None, 3)), arrays.read(informations, np.float64, (None, 3, 3)))


def _read_provenance(arrays: ArrayZip) -> Mapping[str, object]:
    provenance = json.loads(str(arrays.read("provenance", np.str_, ())))
    if not isinstance(provenance, dict):
        raise ValueError("provenance is no JSON object")  # noqa: TRY004  # an error of the file, not of the caller
    return provenance
