"""A grid of free, wall and unknown cells, and arrays over its cells that are sampled at points."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, TbmGrid, walls_and_free

Points = npt.NDArray[np.complexfloating]
"""Points of the plane, x + iy [m]: a rotation is a product."""
Field = npt.NDArray[np.float32]
Reals = npt.NDArray[np.floating]

IS_UNKNOWN, IS_FREE, IS_WALL = 0, 1, 2


@dataclass(frozen=True)
class CellStates:
    """The most likely state of each cell of a map."""

    geometry: GridGeometry
    states: npt.NDArray[np.uint8]
    """IS_UNKNOWN, IS_FREE or IS_WALL (rows, cols)."""

    @classmethod
    def of(cls, grid: TbmGrid) -> "CellStates":
        """Return the state of larger mass; cells with equal masses are unknown."""
        walls, free = walls_and_free(grid)
        states = np.where(walls, np.uint8(IS_WALL), np.where(free, np.uint8(IS_FREE), np.uint8(0)))
        return cls(grid.geometry, states)

    def some(self, chosen: npt.NDArray[np.bool_], limit: int | None = None) -> Points:
        """Return the centres (N,) of the chosen cells, or of at most `limit` of them, evenly spread."""
        return self.centres(evenly(chosen, limit))

    def centres(self, cells: npt.NDArray[np.intp]) -> Points:
        """Return the centres (N,) of cells (N,), counted row by row."""
        x, y = self.geometry.centres_of(*np.divmod(cells, self.geometry.cols)).T
        return np.asarray(x + 1j * y)

    @cached_property
    def known(self) -> tuple[Points, npt.NDArray[np.uint8]]:
        """Centres (N,) and states (N,) of known cells, at most twenty thousand."""
        cells = evenly(self.states != IS_UNKNOWN, 20_000)
        return self.centres(cells), self.states.ravel()[cells]

    @cached_property
    def field(self) -> "CellField":
        """The states for sampling at points; unknown outside of the grid."""
        return CellField.of(self.states, self.geometry, IS_UNKNOWN)

    @cached_property
    def centre(self) -> complex:
        """Centroid of the known cells."""
        points = self.known[0]
        x, y = points.real, points.imag
        return complex(float(x.min() + x.max()) / 2.0, float(y.min() + y.max()) / 2.0)

    @cached_property
    def radius_m(self) -> float:
        """Distance of the farthest known cell from the centroid [m]."""
        return float(np.abs(self.known[0] - self.centre).max())


def evenly(chosen: npt.NDArray[np.bool_], limit: int | None) -> npt.NDArray[np.intp]:
    """Return the indices, row by row, of the chosen cells (rows, cols), or of at most `limit` evenly among them."""
    cells = np.flatnonzero(chosen)
    if limit is None or len(cells) <= limit:
        return cells
    return np.asarray(cells[np.linspace(0, len(cells) - 1, limit).astype(np.intp)])


@dataclass(frozen=True)
class CellField:
    """An array over the cells of a grid that is sampled at points."""

    framed: Field
    """The flat array with a margin of one cell for all points outside of the grid."""
    geometry: GridGeometry
    """Geometry of the cells without the margin."""

    @classmethod
    def of(cls, values: npt.ArrayLike, geometry: GridGeometry, outside: float = 0.0) -> "CellField":
        """Take an array (rows, cols) and the value outside of the grid."""
        framed = np.pad(np.asarray(values, dtype=np.float32), 1, constant_values=outside)
        return cls(framed.ravel(), geometry)

    def at(self, points: Points) -> Field:
        """Return the values of the cells at points (...)."""
        g = self.geometry
        rows = np.clip((points.imag - (g.origin_y - g.resolution)) / g.resolution, 0.0, g.rows + 1.0)
        cols = np.clip((points.real - (g.origin_x - g.resolution)) / g.resolution, 0.0, g.cols + 1.0)
        cells = rows.astype(np.int32) * np.int32(g.cols + 2) + cols.astype(np.int32)
        return np.asarray(self.framed[cells], dtype=np.float32)
