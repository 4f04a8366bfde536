"""What a map from a file must fulfil before anybody computes with it."""

from pathlib import Path

import numpy as np

from tbmslam.errors import TbmSlamError
from tbmslam.grid import GridGeometry, Masses

MAX_CELLS = 400_000_000
"""Cells beyond which a file is not believed: 1 km by 1 km in cells of 5 cm, and 6.4 GB of masses."""

_SUM_TOLERANCE = 1e-3
_CELLS_AT_ONCE = 1 << 20


class MapFileError(TbmSlamError):
    """A file that should hold a map does not."""


def check_geometry(path: Path, geometry: GridGeometry) -> None:
    """Check numbers that a file declares, before memory is taken for them.

    Raises
    ------
    MapFileError
        If the resolution is not positive, a number is not finite, or there are no cells or too many.
    """
    if not (np.isfinite(geometry.resolution) and geometry.resolution > 0.0):
        raise MapFileError(f"{path}: the resolution must be positive, it says {geometry.resolution}: correct it")
    if not np.isfinite([geometry.origin_x, geometry.origin_y]).all():
        raise MapFileError(
            f"{path}: the origin must be finite, it says {geometry.origin_x}, {geometry.origin_y}: correct it"
        )
    if geometry.rows < 1 or geometry.cols < 1:
        raise MapFileError(f"{path}: a map of {geometry.rows} x {geometry.cols} cells holds nothing: make it again")
    if geometry.rows * geometry.cols > MAX_CELLS:
        raise MapFileError(
            f"{path}: {geometry.rows} x {geometry.cols} cells are more than the {MAX_CELLS} that are believed: "
            "crop the map or use coarser cells"
        )


def check_masses(path: Path, masses: Masses) -> None:
    """Check that every cell of (rows, cols, 4) holds a belief.

    Raises
    ------
    MapFileError
        If a mass is not finite or negative, or the masses of a cell do not add up to one.
    """
    cells = masses.reshape(-1, 4)
    for start in range(0, len(cells), _CELLS_AT_ONCE):
        block = cells[start : start + _CELLS_AT_ONCE]
        with np.errstate(invalid="ignore", over="ignore"):
            error = np.abs(block @ np.ones(4, dtype=block.dtype) - 1.0)
        # Whatever is not a number fails both comparisons.
        if not (block.min() >= 0.0 and error.max() <= _SUM_TOLERANCE):
            raise MapFileError(
                f"{path}: there are cells whose masses are no belief (none negative, sum 1): make the map again"
            )
