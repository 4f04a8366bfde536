"""Map dumps of the original programs, `.tbm_map`: both layouts are read, that of vinySLAM is written.

A packed little-endian header (int32 height, int32 width,
float64 side of a cell [m], int32 origin x, y) is followed by the cells, row by row with y ascending. A cell's masses
have the order unknown, empty (that is free), occupied, conflict. The origin is the column and row of the cell whose
lower left corner is (0, 0).

============= ====================== ============================================================
program       cells                  probability and quality that stand before the masses
============= ====================== ============================================================
vinySLAM      49 bytes each, plain   o / (o + e) and o + e; 0.5 and 1 if nothing is known
TBMMapMerging 48 bytes, an LZ4 frame o + u / 2 and 1
============= ====================== ============================================================
"""

import lzma
import os
import struct
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.io.atomic_file import write_bytes
from tbmslam.map.map_check import MapFileError, check_file, check_geometry

_HEADER = struct.Struct("<iidii")
_FILE_ORDER = [UNKNOWN, FREE, OCCUPIED, CONFLICT]
_MERGING_CELL = np.dtype([("probability", "<f8"), ("quality", "<f8"), ("masses", "<f8", 4)])
_SLAM_CELL = np.dtype([("probability", "<f8"), ("quality", "<f8"), ("is_unknown", "u1"), ("masses", "<f8", 4)])
_XZ_MAGIC = b"\xfd7zXZ\0"
_LZ4_MAGIC = b"\x04\x22\x4d\x18"


def read_tbm_dump(path: str | os.PathLike[str]) -> TbmGrid:
    """Read a dump of either layout, distinguished by content; it may be compressed by xz.

    The probability and quality of a cell follow from its masses and are left out. Raises a `MapFileError` if the file
    is missing, cut off, damaged, or holds impossible numbers.
    """
    geometry, body = _unpacked(Path(path))
    cell = _SLAM_CELL if len(body) == geometry.rows * geometry.cols * _SLAM_CELL.itemsize else _MERGING_CELL
    if len(body) != geometry.rows * geometry.cols * cell.itemsize:
        raise MapFileError(
            f"{path}: has {len(body)} bytes for {geometry.rows} x {geometry.cols} cells of 48 or 49: it is cut off "
            "or no .tbm_map"
        )
    cells = np.frombuffer(body, dtype=cell)
    masses = np.empty((len(cells), 4), dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow in float32 gives inf, which is refused below
        masses[:, _FILE_ORDER] = cells["masses"]
    grid = TbmGrid(geometry, masses.reshape(geometry.rows, geometry.cols, 4))
    if (fault := grid.fault()) is not None:
        raise MapFileError(f"{path}: {fault}: it is damaged or no .tbm_map")
    return grid


def write_tbm_dump(path: str | os.PathLike[str], grid: TbmGrid) -> None:
    """Write a grid atomically in the layout of vinySLAM.

    The format has origins in whole cells only. Other origins are rounded, which moves a grid by half a cell at most.
    The grids of `tbmslam.slam` lie on whole cells. Raises a `ValueError` if the origin is too far away
    for the format's 32 bits, and a `FileNotWrittenError` if the file cannot be written.
    """
    geometry = grid.geometry
    origin = [round(-corner / geometry.resolution) for corner in (geometry.origin_x, geometry.origin_y)]
    if any(abs(value) >= 1 << 31 for value in origin):
        raise ValueError(f"origin must lie within 2^31 cells of (0, 0), got {geometry.origin_x}, {geometry.origin_y}")
    header = _HEADER.pack(geometry.rows, geometry.cols, geometry.resolution, *origin)
    write_bytes(path, header + _slam_cells(grid.masses.reshape(-1, 4)).tobytes())


def _slam_cells(masses: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
    cells = np.zeros(len(masses), dtype=_SLAM_CELL)
    cells["masses"] = masses[:, _FILE_ORDER]
    known = masses[:, UNKNOWN] < 1.0
    decided = cells["masses"][:, 1] + cells["masses"][:, 2]
    occupied = cells["masses"][:, 2]
    cells["probability"] = np.divide(occupied, decided, out=np.full(len(cells), 0.5), where=decided > 0.0)
    cells["quality"] = np.where(known, decided, 1.0)
    cells["is_unknown"] = ~known
    return cells


def _unpacked(path: Path) -> tuple[GridGeometry, bytes]:
    """Return the geometry and the bytes of the cells, with at most one byte too many."""
    try:
        check_file(path)
        with path.open("rb") as plain:
            packed = plain.read(len(_XZ_MAGIC)) == _XZ_MAGIC
        with lzma.open(path) if packed else path.open("rb") as file:
            geometry = _geometry(path, file.read(_HEADER.size))
            limit = geometry.rows * geometry.cols * _SLAM_CELL.itemsize + 1
            magic = file.read(len(_LZ4_MAGIC))
            # An LZ4 frame of incompressible data is slightly longer than the data.
            body = magic + file.read(limit + limit // 100 + 64)
    except OSError as error:
        raise MapFileError(f"{path}: cannot be read: {error.strerror}") from error
    except (lzma.LZMAError, EOFError) as error:
        raise MapFileError(f"{path}: is a damaged xz file ({error}): get it again") from error
    return geometry, _lz4_body(path, body, limit) if magic == _LZ4_MAGIC else body


def _geometry(path: Path, header: bytes) -> GridGeometry:
    if len(header) < _HEADER.size:
        raise MapFileError(f"{path}: is shorter than the header of a .tbm_map: it is cut off or something else")
    rows, cols, resolution, origin_col, origin_row = _HEADER.unpack(header)
    geometry = GridGeometry(resolution, -origin_col * resolution, -origin_row * resolution, rows, cols)
    check_geometry(path, geometry)
    return geometry


def _lz4_body(path: Path, frame: bytes, limit: int) -> bytes:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    try:
        body = bytes(decompressor.decompress(frame, max_length=limit))
        if not decompressor.eof:  # only the end mark and the checksum may remain
            body += decompressor.decompress(b"", max_length=1)
    except (RuntimeError, EOFError) as error:
        raise MapFileError(f"{path}: its LZ4 frame is damaged ({error}): get the file again") from error
    if not decompressor.eof:
        raise MapFileError(f"{path}: its LZ4 frame does not end where its cells do: it is cut off or no .tbm_map")
    return body
