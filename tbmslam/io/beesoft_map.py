"""Maps of the Beesoft programs, such as CMU's Wean Hall, for comparisons.

A text file, plain or gzipped: lines of settings that end with ``global_map[0]: ROWS COLS``, then a probability of being
free for each cell, -1 if nothing is known. A line of numbers runs along y and the lines follow each other along x;
drives in that building show that this is no mirror image.
"""

import gzip
import os
import re
import zlib
from pathlib import Path

import numpy as np

from tbmslam.belief.grid import GridGeometry, TbmGrid, masses_from_probability
from tbmslam.geometry.se2 import FloatArray
from tbmslam.map.map_check import MapFileError, check_file, check_geometry, check_size

DOUBTFUL = (0.2, 0.8)
"""Probabilities between these are unknown: such cells are behind walls, where the program guessed."""

_GZIP_MAGIC = b"\x1f\x8b"
_RESOLUTION = re.compile(r"^robot_specifications->resolution\s+(\S+)\s*$", re.MULTILINE)
_SIZE = re.compile(r"^global_map\[0\]:[ \t]+(\d{1,9})[ \t]+(\d{1,9})[ \t]*\n", re.MULTILINE)
_CM = 0.01
_HEAD_BYTES, _BYTES_A_CELL = 1 << 16, 16


def read_beesoft_map(path: str | os.PathLike[str]) -> TbmGrid:
    """Read a building map with cell (0, 0) at the origin; raise a `MapFileError` if the file is no such map."""
    path = Path(path)
    text = _text(path)
    size, resolution = _SIZE.search(text), _RESOLUTION.search(text)
    if size is None or resolution is None:
        raise MapFileError(f"{path}: lacks the resolution or global_map[0] of a Beesoft map: it is something else")
    lines, columns = int(size[1]), int(size[2])
    try:
        geometry = GridGeometry(float(resolution[1]) * _CM, 0.0, 0.0, rows=columns, cols=lines)
        check_geometry(path, geometry)
        free: FloatArray = np.array(text[size.end() :].split(), dtype=np.float64)
    except ValueError as error:
        raise MapFileError(f"{path}: holds text that is no number ({str(error)[:120]}): it is damaged") from None
    if len(free) != lines * columns or not np.isfinite(free).all() or free.max() > 1.0:
        raise MapFileError(
            f"{path}: must hold {lines} x {columns} probabilities, it has {len(free)} numbers up to "
            f"{free.max(initial=0.0)}: it is damaged"
        )
    free = free.reshape(lines, columns).T
    low, high = DOUBTFUL
    known = ((free >= 0.0) & (free <= low)) | (free >= high)
    return TbmGrid(geometry, masses_from_probability(1.0 - free, known))


def _text(path: Path) -> str:
    """Return the text of the file, limited to the largest size of a map."""
    try:
        check_file(path)
        with path.open("rb") as plain:
            zipped = plain.read(2) == _GZIP_MAGIC
        with gzip.open(path) if zipped else path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
            size = _SIZE.search(head.decode("ascii"))
            if size is None:
                return head.decode("ascii")
            lines, columns = int(size[1]), int(size[2])
            check_size(path, lines, columns)
            return (head + file.read(lines * columns * _BYTES_A_CELL)).decode("ascii")
    except (EOFError, zlib.error, gzip.BadGzipFile, UnicodeDecodeError) as error:
        raise MapFileError(
            f"{path}: is not the text of a Beesoft map ({error}): it is damaged or something else"
        ) from error
    except OSError as error:
        raise MapFileError(f"{path}: cannot be read: {error.strerror}") from error
