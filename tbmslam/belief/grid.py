"""A grid of masses and its geometry, and the conversion of other maps' occupancies to masses and back."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN, VACUOUS, Masses, pignistic
from tbmslam.belief.tiled_masses import TiledMasses
from tbmslam.geometry.se2 import FloatArray

SUM_TOLERANCE = 1e-3
"""Largest deviation of the sum of a cell's masses from one, by rounding in float32."""
_BAND = 256  # rows that are processed together, to limit the memory
_SLIVER = 1e-6  # largest rounding error of an edge, as a share of a cell


class GridGeometry(NamedTuple):
    """The cells of a grid in the plane: rows increase with y, columns with x."""

    resolution: float
    """Side of a cell [m]."""
    origin_x: float
    origin_y: float
    """Outer corner of cell (0, 0) in the grid's frame [m]."""
    rows: int
    cols: int
    """Number of cells along y and x."""

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """Return (row, col) of the cell that contains a point [m]; it may lie outside the grid."""
        return (math.floor((y - self.origin_y) / self.resolution), math.floor((x - self.origin_x) / self.resolution))

    def cells_at(
        self, points: FloatArray
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """Return the rows and columns of points (N, 2) [m], clipped to the grid, and which points lie inside."""
        cols = np.floor((points[:, 0] - self.origin_x) / self.resolution).astype(np.int64)
        rows = np.floor((points[:, 1] - self.origin_y) / self.resolution).astype(np.int64)
        inside = (rows >= 0) & (rows < self.rows) & (cols >= 0) & (cols < self.cols)
        return np.clip(rows, 0, self.rows - 1), np.clip(cols, 0, self.cols - 1), inside

    def centre_of(self, row: float, col: float) -> tuple[float, float]:
        """Return the centre (x, y) of a cell [m]; fractions are interpolated."""
        return (self.origin_x + (col + 0.5) * self.resolution, self.origin_y + (row + 0.5) * self.resolution)

    def centres_of(self, rows: npt.NDArray[np.integer], cols: npt.NDArray[np.integer]) -> FloatArray:
        """Return the centres (N, 2) of cells (N,) [m]."""
        x = self.origin_x + (cols + 0.5) * self.resolution
        y = self.origin_y + (rows + 0.5) * self.resolution
        return np.column_stack((x, y))

    def bounds(self) -> tuple[float, float, float, float]:
        """Return the outer edges (min_x, min_y, max_x, max_y) [m]."""
        return (
            self.origin_x,
            self.origin_y,
            self.origin_x + self.cols * self.resolution,
            self.origin_y + self.rows * self.resolution,
        )

    def part(self, top: int, bottom: int, left: int, right: int) -> "GridGeometry":
        """Return the geometry of some rows and columns of the lattice of these cells, also outside of the grid."""
        x, y = self.origin_x + left * self.resolution, self.origin_y + top * self.resolution
        return GridGeometry(self.resolution, x, y, bottom - top, right - left)

    def mirrored(self) -> "GridGeometry":
        """Return the geometry mirrored at the y axis."""
        return self._replace(origin_x=-(self.origin_x + self.cols * self.resolution))


@dataclass(frozen=True, repr=False)
class TbmGrid:
    """A grid of masses of the Transferable Belief Model.

    Parameters
    ----------
    geometry
        Geometry of the cells.
    cells
        Masses (rows, cols, 4), float32, ordered CONFLICT, FREE, OCCUPIED, UNKNOWN as in `tbmslam.belief.masses`: an
        array, or tiles, which take less memory where most cells are unknown.
    """

    geometry: GridGeometry
    cells: Masses | TiledMasses

    def __post_init__(self) -> None:
        """Check that geometry and masses match."""
        expected = (self.geometry.rows, self.geometry.cols, 4)
        if self.cells.shape != expected:
            raise ValueError(f"masses must have the shape {expected} of the geometry, got {self.cells.shape}")
        if not (self.geometry.resolution > 0.0 and math.isfinite(self.geometry.resolution)):
            raise ValueError(f"resolution must be positive, got {self.geometry.resolution}")
        if not (math.isfinite(self.geometry.origin_x) and math.isfinite(self.geometry.origin_y)):
            raise ValueError(f"origin must be finite, got {self.geometry.origin_x}, {self.geometry.origin_y}")

    def __repr__(self) -> str:
        """Return the size in a line."""
        return f"TbmGrid({self.summary()})"

    def summary(self) -> str:
        """Return the size as text."""
        g = self.geometry
        return f"{g.cols} x {g.rows} cells of {g.resolution:g} m, {self.known_m2():.1f} m2 known"

    def _repr_png_(self) -> bytes | None:
        """Return the picture that a notebook shows: free white, occupied black, unknown grey; y grows upwards."""
        import cv2  # noqa: PLC0415  # slow to load, and only notebooks draw here

        grey = np.rint(255.0 * (1.0 - self.pignistic()[::-1])).astype(np.uint8)
        return cv2.imencode(".png", grey)[1].tobytes() if grey.size else None

    @classmethod
    def unknown(cls, geometry: GridGeometry) -> "TbmGrid":
        """Return a grid of unknown cells."""
        return cls(geometry, np.broadcast_to(VACUOUS.astype(np.float32), (geometry.rows, geometry.cols, 4)).copy())

    @property
    def masses(self) -> Masses:
        """The masses (rows, cols, 4) as an array. Of tiles it is drawn at each access, and cannot be changed."""
        if not isinstance(self.cells, TiledMasses):
            return self.cells
        drawn = self.window(0, self.geometry.rows, 0, self.geometry.cols)
        drawn.flags.writeable = False
        return drawn

    def pieces(self) -> Iterator[tuple[slice, slice, Masses]]:
        """Yield parts of the grid with their rows and columns; cells in no part are vacuous."""
        rows, cols = self.geometry.rows, self.geometry.cols
        if isinstance(self.cells, TiledMasses):
            yield from self.cells.pieces(0, rows, 0, cols)
            return
        for first in range(0, rows, _BAND):
            band = slice(first, min(first + _BAND, rows))
            yield band, slice(0, cols), self.cells[band]

    def window(self, top: int, bottom: int, left: int, right: int) -> Masses:
        """Return the masses (bottom - top, right - left, 4) of some rows and columns, which must be in the grid."""
        if isinstance(self.cells, TiledMasses):
            return self.cells.window(top, bottom, left, right)
        return self.cells[top:bottom, left:right]

    def fault(self) -> str | None:
        """Return why the masses are invalid, such as one below zero; None if they are valid."""
        for _, _, masses in self.pieces():
            block = masses.reshape(-1, 4)
            if not block.min(initial=0.0) >= 0.0:  # also for nan
                return f"a mass is {block.min()}, not zero or more"
            error = float(np.abs(block @ np.ones(4, dtype=block.dtype) - 1.0).max(initial=0.0))
            if not error <= SUM_TOLERANCE:
                return f"the masses of a cell miss the sum of 1 by {error:.3g}"
        return None

    def is_known(self) -> npt.NDArray[np.bool_]:
        """Return which cells (rows, cols) have any evidence."""
        if isinstance(self.cells, TiledMasses):
            return self.cells.known()
        return np.asarray(self.cells[..., UNKNOWN] < 1.0)

    def known_m2(self) -> float:
        """Return the area of the known cells [m^2]."""
        return np.count_nonzero(self.is_known()) * self.geometry.resolution**2

    def pignistic(self) -> FloatArray:
        """Return the probability (rows, cols) of being occupied."""
        probability = np.full(self.cells.shape[:2], 0.5)
        for rows, cols, masses in self.pieces():
            probability[rows, cols] = pignistic(masses)
        return probability

    def masses_of_rows(self, first: int, last: int) -> Masses:
        """Return the masses of the rows from `first` up to, and without, `last`."""
        return self.window(first, last, 0, self.geometry.cols)

    def mirrored(self) -> "TbmGrid":
        """Return the grid mirrored at its y axis."""
        cells = self.cells
        flipped = cells.mirrored() if isinstance(cells, TiledMasses) else np.ascontiguousarray(cells[:, ::-1])
        return TbmGrid(self.geometry.mirrored(), flipped)

    def cropped(self, min_x: float, min_y: float, max_x: float, max_y: float) -> "TbmGrid":
        """Return the cells that touch a rectangle [m]."""
        g = self.geometry
        low = np.floor(np.array([min_y - g.origin_y, min_x - g.origin_x]) / g.resolution + _SLIVER)
        high = np.ceil(np.array([max_y - g.origin_y, max_x - g.origin_x]) / g.resolution - _SLIVER)
        (top, left), (bottom, right) = (np.clip(edge, 0, (g.rows, g.cols)).astype(int).tolist() for edge in (low, high))
        if top >= bottom or left >= right:
            raise no_cell_error(g, min_x, min_y, max_x, max_y)
        return _without_rest(self.part(top, bottom, left, right))

    def known_part(self, margin: int = 0) -> "TbmGrid":
        """Return a view of the smallest part with all known cells; see `cropped_to_known`."""
        known = self.is_known()
        rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        if rows.size == 0:
            return self
        top, bottom = max(rows[0] - margin, 0), min(rows[-1] + 1 + margin, self.geometry.rows)
        left, right = max(cols[0] - margin, 0), min(cols[-1] + 1 + margin, self.geometry.cols)
        return self.part(int(top), int(bottom), int(left), int(right))

    def part(self, top: int, bottom: int, left: int, right: int) -> "TbmGrid":
        """Return a view of some rows and columns, which must be in the grid."""
        cells = self.cells
        inside = (
            cells.part(top, bottom, left, right) if isinstance(cells, TiledMasses) else cells[top:bottom, left:right]
        )
        return TbmGrid(self.geometry.part(top, bottom, left, right), inside)

    def cropped_to_known(self, margin: int = 0) -> "TbmGrid":
        """Return the smallest part with all known cells, with a margin of cells where the grid has them.

        A grid without evidence is returned unchanged.
        """
        part = self.known_part(margin)
        return self if part is self else _without_rest(part)


def no_cell_error(geometry: GridGeometry, x0: float, y0: float, x1: float, y1: float) -> ValueError:
    """Return the error of a part, from point to point [m], that holds no cell of a grid."""
    left, bottom, right, top = geometry.bounds()
    return ValueError(
        f"({x0:g}, {y0:g}) to ({x1:g}, {y1:g}) m holds no cell of the map, which reaches from "
        f"({left:.2f}, {bottom:.2f}) to ({right:.2f}, {top:.2f}) m"
    )


def _without_rest(part: TbmGrid) -> TbmGrid:
    """Return a view of a grid as a grid of its own, so that the rest takes no memory."""
    cells = part.cells
    return TbmGrid(part.geometry, cells if isinstance(cells, TiledMasses) else np.ascontiguousarray(cells))


RELIABILITY = 0.9
"""Reliability of a map of probabilities, whose certainty is unknown."""

MIN_BALANCE = 0.1
"""Least difference of the masses of free and occupied for a decision; see `occupancy_of`."""


def walls_and_free(grid: TbmGrid) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Return which cells (rows, cols) have more mass on occupied than on free, and which have less."""
    walls, free = np.zeros((2, *grid.cells.shape[:2]), dtype=np.bool_)
    for rows, cols, masses in grid.pieces():
        walls[rows, cols] = masses[..., OCCUPIED] > masses[..., FREE]
        free[rows, cols] = masses[..., FREE] > masses[..., OCCUPIED]
    return walls, free


def occupancy_of(grid: TbmGrid) -> npt.NDArray[np.int8]:
    """Return the occupancy (rows, cols) as map_server publishes it: 0 free, 100 occupied, -1 unknown; row grows with y.

    A cell is occupied if its pignistic probability is above 0.55, and free if it is below 0.45: the masses of the two
    then differ by `MIN_BALANCE` of the mass that is not conflict. A cell with little evidence, or with equal evidence
    for both, is unknown. The bounds lie near one half because the pignistic probability adds half of UNKNOWN to both,
    and free space is learnt slowly: after 100 misses vinySLAM's m(FREE) is 0.23.
    """
    occupancy = np.full(grid.cells.shape[:2], -1, dtype=np.int8)
    # Intermediate arrays of a whole map would take more memory than the map.
    for rows, cols, masses in grid.pieces():
        decided = occupancy[rows, cols]
        balance = masses[..., OCCUPIED] - masses[..., FREE]
        needed = MIN_BALANCE * (1.0 - masses[..., CONFLICT])
        decided[balance > needed] = 100
        decided[-balance > needed] = 0
    return occupancy


def masses_from_occupancy(occupancy: npt.NDArray[np.int8]) -> Masses:
    """Return the beliefs (..., 4) of occupancies (...) from 0 to 100, -1 unknown; see `masses_from_probability`."""
    percent = np.arange(-1, 101)
    table = masses_from_probability(percent / 100.0, known=percent >= 0)
    return np.asarray(table[occupancy.astype(np.int16) + 1])


def masses_from_probability(probability: FloatArray, known: npt.NDArray[np.bool_]) -> Masses:
    """Return the least committed beliefs (..., 4) with a given pignistic probability (...), discounted.

    Of all beliefs with pignistic value p, the one with the most mass on UNKNOWN has m(OCCUPIED) = 2p - 1 for p above
    one half, m(FREE) = 1 - 2p below, and the rest on UNKNOWN (Dubois, Prade, Smets, "A definition of subjective
    possibility", 2008). It claims nothing beyond the probability, and p of one half is no evidence. It is then
    discounted by `RELIABILITY`: a certain cell keeps a mass of 0.1 on UNKNOWN. Cells that are not `known` get 1.
    """
    lean = np.where(known, 2.0 * probability - 1.0, 0.0) * RELIABILITY
    masses: Masses = np.zeros((*lean.shape, 4), dtype=np.float32)
    masses[..., OCCUPIED] = np.maximum(lean, 0.0)
    masses[..., FREE] = np.maximum(-lean, 0.0)
    masses[..., UNKNOWN] = 1.0 - masses[..., OCCUPIED] - masses[..., FREE]
    return masses
