"""A grid resampled on the cells of another grid, in another frame.

Where the new cells are as fine as the old ones or finer, each takes the belief of the old cell its centre lies in:
exact to half a cell, and a wall stays as sharp and as certain as it was, where interpolation would smear it into the
free space beside it. Where the new cells are coarser, each takes the mean over the area it covers, or else thin walls
would fall between the centres. Both are convex combinations of beliefs, hence beliefs.
"""

import math
from dataclasses import dataclass

import numpy as np

from tbmslam.belief.grid import GridGeometry, Masses, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.grids import resampling as kernels


@dataclass(frozen=True)
class PlacedGrid:
    """A grid that is resampled on the cells of another frame, some rows at a time."""

    grid: TbmGrid
    """The source grid."""
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
        row_of, col_of = _cells_in_source(self.grid.geometry, self.T_target_source, self.geometry)
        # A ratio slightly above 1 is a rounding error, not a coarser grid.
        samples = max(1, math.ceil(self.geometry.resolution / self.grid.geometry.resolution - 1e-6))
        resampled = np.empty((last - first, self.geometry.cols, 4), dtype=np.float32)
        kernels.resample(np.asarray(self.grid.masses, dtype=np.float32), row_of, col_of, samples, first, resampled)
        return resampled

    def drawn(self) -> TbmGrid:
        """Return the beliefs on the target's cells; cells outside of the source are unknown."""
        return TbmGrid(self.geometry, self.masses_of_rows(0, self.geometry.rows))


def resample(grid: TbmGrid, T_target_source: SE2, geometry: GridGeometry) -> TbmGrid:
    """Resample a grid on the cells of another frame; see `PlacedGrid`.

    Raises
    ------
    ValueError
        If the transform or the geometry is not finite.
    """
    return PlacedGrid(grid, T_target_source, geometry).drawn()


def canvas_of(source: GridGeometry, T_target_source: SE2) -> GridGeometry:
    """Return the cells of another frame that cover a grid, of the same size."""
    left, bottom, right, top = source.bounds()
    corners = T_target_source.apply([(left, bottom), (right, bottom), (right, top), (left, top)])
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
