"""A grid resampled on the cells of another grid, in another frame.

If the new cells are not coarser than the old ones, each takes the belief of the old cell that holds its centre. This
is exact to half a cell, and walls stay sharp and certain. Interpolation would smear them into the free space beside
them.

A coarser cell is occupied if any part of it is. So it takes the belief of the most occupied old cell that it covers, if
that is rather occupied than free; a mean would turn walls that are thinner than the new cells into free space.
Otherwise it takes the mean over its area. All are convex combinations of beliefs, so they are beliefs.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import Masses
from tbmslam.belief.tiled_masses import SIDE, TiledMasses, vacuous_masses
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.grids import resampling as kernels

_BLOCK = 8 * SIDE  # side of the blocks of the target for which tiles are put together to an array


@dataclass(frozen=True)
class PlacedGrid:
    """A grid that is resampled on the cells of another frame, some rows at a time."""

    grid: TbmGrid
    T_target_source: SE2
    """Pose of the source's frame in the target's frame."""
    geometry: GridGeometry
    """The target's cells in its frame, with any resolution, size and origin."""

    def __post_init__(self) -> None:
        """Check transform and geometry."""
        if not np.isfinite([*self.T_target_source, *self.geometry]).all():
            raise ValueError(f"transform and geometry must be finite, got {self.T_target_source} and {self.geometry}")

    def masses_of_rows(self, first: int, last: int) -> Masses:
        """Return the masses of the target's rows from `first` up to, and without, `last`."""
        if not isinstance(self.grid.cells, TiledMasses):
            resampled = np.empty((last - first, self.geometry.cols, 4), dtype=np.float32)
            self._read(np.asarray(self.grid.cells, dtype=np.float32), (0, 0), (first, 0), resampled)
            return resampled
        resampled = vacuous_masses(last - first, self.geometry.cols)
        for top in range(first, last, _BLOCK):
            for left in range(0, self.geometry.cols, _BLOCK):
                block = resampled[top - first : min(top + _BLOCK, last) - first, left : left + _BLOCK]
                self._read_block(self.grid.cells, (top, left), block)
        return resampled

    def _read_block(self, cells: TiledMasses, first: tuple[int, int], resampled: Masses) -> None:
        """Write a block of the target's cells from the row and column `first` on, if the source has evidence there."""
        ends = [np.array([at, at + size]) for at, size in zip(first, resampled.shape[:2], strict=True)]
        corners = np.array([(row, col, 1.0) for row in ends[0] for col in ends[1]])
        source = np.column_stack([corners @ of for of in self._affine])
        # A cell more all around: the corners are rounded.
        low = np.maximum(np.floor(source.min(axis=0)).astype(int) - 1, 0)
        high = np.minimum(np.floor(source.max(axis=0)).astype(int) + 2, cells.shape[:2])
        (top, left), (bottom, right) = low.tolist(), high.tolist()
        if top < bottom and left < right and cells.has_evidence(top, bottom, left, right):
            self._read(cells.window(top, bottom, left, right), (top, left), first, resampled)

    def _read(self, masses: Masses, corner: tuple[int, int], first: tuple[int, int], resampled: Masses) -> None:
        """Write the target's cells from the row and column `first` on; the source's masses begin at `corner`."""
        # A ratio slightly above 1 is a rounding error, not a coarser grid.
        samples = max(1, math.ceil(self.geometry.resolution / self.grid.geometry.resolution - 1e-6))
        size = self.grid.geometry.rows, self.grid.geometry.cols
        kernels.resample(masses, corner, size, *self._affine, samples, first, resampled)

    @cached_property
    def _affine(self) -> tuple[np.ndarray, np.ndarray]:
        return _cells_in_source(self.grid.geometry, self.T_target_source, self.geometry)

    def drawn(self) -> TbmGrid:
        """Return the beliefs on the target's cells; cells outside of the source are unknown."""
        rows = self.geometry.rows
        if not isinstance(self.grid.cells, TiledMasses):
            return TbmGrid(self.geometry, self.masses_of_rows(0, rows))
        tiled = TiledMasses(rows, self.geometry.cols)
        for first in range(0, rows, _BLOCK):
            tiled.put_rows(first, self.masses_of_rows(first, min(first + _BLOCK, rows)))
        return TbmGrid(self.geometry, tiled)


def resample(grid: TbmGrid, T_target_source: SE2, geometry: GridGeometry) -> TbmGrid:
    """Resample a grid on the cells of another frame; see `PlacedGrid`.

    Raises a `ValueError` if the transform or the geometry is not finite.
    """
    return PlacedGrid(grid, T_target_source, geometry).drawn()


def corners_of(source: GridGeometry, T_target_source: SE2) -> FloatArray:
    """Return the corners (4, 2) of a grid in the frame it is placed in [m]."""
    left, bottom, right, top = source.bounds()
    return T_target_source.apply([(left, bottom), (right, bottom), (right, top), (left, top)])


def canvas_of(source: GridGeometry, T_target_source: SE2) -> GridGeometry:
    """Return the cells of equal size in another frame that cover a grid."""
    corners = corners_of(source, T_target_source)
    low = corners.min(axis=0)
    # Rounding must not add a row of cells outside of the grid.
    cols, rows = np.ceil((corners.max(axis=0) - low) / source.resolution - 1e-6).astype(int)
    return GridGeometry(source.resolution, float(low[0]), float(low[1]), int(rows), int(cols))


def _cells_in_source(source: GridGeometry, T_target_source: SE2, target: GridGeometry) -> tuple[np.ndarray, np.ndarray]:
    """Return the affine maps from target (row, col, 1) to the source's row and column, in cells from the corner."""
    T_source_target = T_target_source.inverse()
    corner_x, corner_y = T_source_target.apply([target.origin_x, target.origin_y])
    ratio = target.resolution / source.resolution
    cosine, sine = math.cos(T_source_target.theta) * ratio, math.sin(T_source_target.theta) * ratio
    row_of = np.array([cosine, sine, (corner_y - source.origin_y) / source.resolution])
    col_of = np.array([-sine, cosine, (corner_x - source.origin_x) / source.resolution])
    return row_of, col_of
