"""The grid of a SLAM: its cells accumulate evidence, from which belief masses are computed.

Combining simple observations by the conjunctive rule multiplies their commonalities q(A), the sum of m(B) over B
containing A (Shafer 1976; Smets 1990). A cell that starts vacuous is therefore known by two numbers that are updated
by one product each, without the divisions of Dempster's rule, in any order::

    free     a_F = q(FREE) / q(UNKNOWN)     = (m(FREE) + m(UNKNOWN)) / m(UNKNOWN)          >= 1
    occupied a_O = q(OCCUPIED) / q(UNKNOWN) = (m(OCCUPIED) + m(UNKNOWN)) / m(UNKNOWN)      >= 1

and Dempster's masses are m(UNKNOWN) = 1/K, m(FREE) = (a_F - 1)/K, m(OCCUPIED) = (a_O - 1)/K with K = a_F + a_O - 1.
"""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.rays.lattice import Lattice


class GridTooLargeError(TbmSlamError):
    """The map would need more memory than its limit."""


def check_size(rows: int, cols: int, resolution: float, max_cells: int) -> None:
    """Raise a `GridTooLargeError` if the grid has more cells than allowed."""
    if rows * cols > max_cells:
        raise GridTooLargeError(
            f"the map would grow to {rows} x {cols} cells of {resolution} m, more than the limit of "
            f"{max_cells} cells: raise map.max_cells, use a coarser map.resolution or a shorter map.insertion.max_range"
        )


class EvidenceGrid:
    """A growing grid on the lattice of cells whose corners are multiples of the resolution [m].

    `ratios` (rows, cols, 2) are a_F and a_O of every cell, 16 bytes for each of at most `max_cells` cells. The corner
    of cell (0, 0) is at (`first_col`, `first_row`) times the resolution.
    """

    GROWTH = 1.2
    """Least growth of a side, so that the grid is copied rarely."""

    def __init__(self, resolution: float, max_cells: int = 200_000_000) -> None:
        if not resolution > 0.0:
            raise ValueError(f"resolution must be positive, got {resolution}")
        self.resolution = resolution
        self.max_cells = max_cells
        self.first_row = 0
        self.first_col = 0
        self.ratios: FloatArray = np.ones((0, 0, 2))

    @property
    def lattice(self) -> Lattice:
        """The cells on the unbounded lattice."""
        return Lattice(self.resolution, self.first_row, self.first_col)

    @property
    def geometry(self) -> GridGeometry:
        """Geometry of the cells."""
        rows, cols = self.ratios.shape[:2]
        return GridGeometry(
            self.resolution, self.first_col * self.resolution, self.first_row * self.resolution, rows, cols
        )

    def grow_to_contain(self, points: FloatArray) -> None:
        """Grow until points (N, 2) [m] are inside, with a margin of a cell.

        Raises a `GridTooLargeError` if the grid would exceed `max_cells`; it is left as it was.
        """
        if len(points) == 0:
            return
        low, high = points.min(axis=0), points.max(axis=0)
        rows, cols = self.ratios.shape[:2]
        row_start, row_stop = self._grown(low[1], high[1], self.first_row, rows)
        col_start, col_stop = self._grown(low[0], high[0], self.first_col, cols)
        new_rows, new_cols = row_stop - row_start, col_stop - col_start
        if (new_rows, new_cols) == (rows, cols):
            return
        check_size(new_rows, new_cols, self.resolution, self.max_cells)
        grown = np.ones((new_rows, new_cols, 2))
        if rows and cols:
            top, left = self.first_row - row_start, self.first_col - col_start
            grown[top : top + rows, left : left + cols] = self.ratios
        self.ratios, self.first_row, self.first_col = grown, row_start, col_start

    def _grown(self, low: float, high: float, first: int, count: int) -> tuple[int, int]:
        """Return the half-open lattice range of one axis that holds [low, high]."""
        need_start = math.floor(low / self.resolution) - 1
        need_stop = math.floor(high / self.resolution) + 2
        if count == 0:
            return need_start, need_stop
        start, stop = min(first, need_start), max(first + count, need_stop)
        if (start, stop) == (first, first + count):
            return start, stop
        spare = max(math.ceil(self.GROWTH * count) - (stop - start), 0)
        return (start - spare, stop) if need_start < first else (start, stop + spare)

    def to_tbm_grid(self, keep_conflict: bool = False) -> TbmGrid:
        """Return the masses of every cell.

        Dempster's rule normalises the conflict away (as in vinySLAM). With `keep_conflict`, hits and misses are two
        sources that are combined conjunctively (eq. 5): a cell that was both hit and passed, such as a door, keeps the
        conflict as a mass.
        """
        free_ratio, occupied_ratio = self.ratios[..., 0], self.ratios[..., 1]
        masses: npt.NDArray[np.float32] = np.empty((*free_ratio.shape, 4), dtype=np.float32)
        if keep_conflict:
            unknown = 1.0 / (free_ratio * occupied_ratio)
            masses[..., CONFLICT] = (free_ratio - 1.0) * (occupied_ratio - 1.0) * unknown
        else:
            unknown = 1.0 / (free_ratio + occupied_ratio - 1.0)
            masses[..., CONFLICT] = 0.0
        masses[..., FREE] = (free_ratio - 1.0) * unknown
        masses[..., OCCUPIED] = (occupied_ratio - 1.0) * unknown
        masses[..., UNKNOWN] = unknown
        return TbmGrid(self.geometry, masses)
