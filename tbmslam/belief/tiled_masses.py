"""Masses of a grid in square tiles, of which only those with evidence are stored.

Most cells of a large building are never seen: a ring of corridors of 300 x 140 m covers 7 % of its box, and its tiles
hold 15 % of it.
"""

import math
import mmap
from collections.abc import Iterator, Mapping
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tbmslam.belief.masses import UNKNOWN, VACUOUS, Masses

_Scalar = TypeVar("_Scalar", bound=np.generic)


def sparse_zeros(shape: tuple[int, ...], dtype: type[_Scalar], least_bytes: int = 1 << 22) -> npt.NDArray[_Scalar]:
    """Return zeros of a shape; a page of 4 kB takes memory when something is written to it.

    `numpy.zeros` of a large array takes pages of 2 MB, so one cell that is written takes the memory of 36 rows of a map
    of 7000 columns. Large pages are faster to access, so smaller arrays than `least_bytes` come from `numpy.zeros`,
    which takes large pages from 4 MB on.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size < least_bytes or not hasattr(mmap, "MADV_NOHUGEPAGE"):
        return np.zeros(shape, dtype=dtype)
    try:
        memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE)
        memory.madvise(mmap.MADV_NOHUGEPAGE)
    except OSError:  # a kernel without large pages, or too little memory
        return np.zeros(shape, dtype=dtype)
    return np.frombuffer(memory, dtype=dtype).reshape(shape)


SIDE = 32
"""Cells along a tile. Tiles of 16 cells store 11 % of the ring above, of 64 cells 23 %; small ones take more time."""

_VACUOUS_CELL = VACUOUS.astype(np.float32).view(np.complex128)[0]
"""The bits of a vacuous cell as one number of 16 bytes, which NumPy fills in faster than four numbers."""

Place = tuple[int, int]
"""Row and column of a tile."""


class TiledMasses:
    """Masses (rows, cols, 4) in tiles; a tile that is not stored is vacuous, to the last bit.

    `tiles` are the stored tiles (SIDE, SIDE, 4) by their place. Parts share them, so they are never changed; only the
    methods `put_...` add tiles. `first` is the row and column of cell (0, 0), counted from the corner of tile (0, 0).
    """

    def __init__(
        self, rows: int, cols: int, tiles: Mapping[Place, Masses] | None = None, first: tuple[int, int] = (0, 0)
    ) -> None:
        self.shape = rows, cols, 4
        self.first = first
        self.tiles: dict[Place, Masses] = {} if tiles is None else dict(tiles)

    @classmethod
    def of(cls, masses: Masses) -> "TiledMasses":
        """Return the tiles of an array (rows, cols, 4)."""
        tiled = cls(*masses.shape[:2])
        for first in range(0, len(masses), SIDE):
            tiled.put_rows(first, masses[first : first + SIDE])
        return tiled

    def put_rows(self, first: int, masses: Masses) -> None:
        """Store a band of rows (K, cols, 4); `first` is a multiple of `SIDE`, and only the last band may end between.

        Threads may put different bands at once.
        """
        # Cells are compared as two numbers of 8 bytes, all of a row along one axis: a last axis of two takes NumPy
        # twenty times as long.
        vacuous = vacuous_masses(1, masses.shape[1]).view(np.uint64).reshape(-1)
        corners = np.arange(0, len(vacuous), 2 * SIDE)
        for top in range(0, len(masses), SIDE):
            band = np.ascontiguousarray(masses[top : top + SIDE], dtype=np.float32)
            is_known = (band.view(np.uint64).reshape(len(band), -1) != vacuous).any(axis=0)
            for col in np.flatnonzero(np.logical_or.reduceat(is_known, corners)).tolist():
                self.put_tile((first + top) // SIDE, col, band[:, col * SIDE : (col + 1) * SIDE])

    def put_tiles(self, places: npt.NDArray[np.int64], tiles: Masses) -> None:
        """Store tiles (N, SIDE, SIDE, 4) at places (N, 2); their cells outside the grid are vacuous."""
        tiles.flags.writeable = False
        self.tiles.update(zip(map(tuple, places.tolist()), tiles, strict=True))

    def put_tile(self, row: int, col: int, masses: Masses) -> None:
        """Store a copy of a tile, or of the part of it that lies inside the grid."""
        tile = vacuous_masses(SIDE, SIDE)
        tile[: masses.shape[0], : masses.shape[1]] = masses
        tile.flags.writeable = False
        self.tiles[row, col] = tile

    def pieces(self, top: int, bottom: int, left: int, right: int) -> Iterator[tuple[slice, slice, Masses]]:
        """Yield all stored masses within some rows and columns, with their rows and columns in the grid."""
        first_row, first_col = self.first
        tile_cols = _tiles_over(first_col + left, first_col + right)
        for row in _tiles_over(first_row + top, first_row + bottom):
            for col in tile_cols:
                tile = self.tiles.get((row, col))
                if tile is None:
                    continue
                at_row, at_col = row * SIDE - first_row, col * SIDE - first_col
                low, high = max(top, at_row), min(bottom, at_row + SIDE)
                near, far = max(left, at_col), min(right, at_col + SIDE)
                inside = tile[low - at_row : high - at_row, near - at_col : far - at_col]
                yield slice(low, high), slice(near, far), inside

    def has_evidence(self, top: int, bottom: int, left: int, right: int) -> bool:
        """Return whether a tile is stored within some rows and columns."""
        return next(self.pieces(top, bottom, left, right), None) is not None

    def window(self, top: int, bottom: int, left: int, right: int) -> Masses:
        """Return the masses (bottom - top, right - left, 4) of some rows and columns as an array."""
        drawn = vacuous_masses(bottom - top, right - left)
        for rows, cols, masses in self.pieces(top, bottom, left, right):
            drawn[rows.start - top : rows.stop - top, cols.start - left : cols.stop - left] = masses
        return drawn

    def part(self, top: int, bottom: int, left: int, right: int) -> "TiledMasses":
        """Return some rows and columns; the tiles are shared."""
        first_row, first_col = self.first
        rows, cols = _tiles_over(first_row + top, first_row + bottom), _tiles_over(first_col + left, first_col + right)
        kept = {place: tile for place, tile in self.tiles.items() if place[0] in rows and place[1] in cols}
        return TiledMasses(bottom - top, right - left, kept, (first_row + top, first_col + left))

    def mirrored(self) -> "TiledMasses":
        """Return the masses with the columns in reverse order."""
        rows, cols, _ = self.shape
        first_row, first_col = self.first
        across = (first_col + cols - 1) // SIDE + 1
        tiles = {(row, across - 1 - col): tile[:, ::-1] for (row, col), tile in self.tiles.items()}
        return TiledMasses(rows, cols, tiles, (first_row, across * SIDE - first_col - cols))

    def known(self) -> npt.NDArray[np.bool_]:
        """Return which cells (rows, cols) have any evidence."""
        rows, cols, _ = self.shape
        known = np.zeros((rows, cols), dtype=np.bool_)
        for at_rows, at_cols, masses in self.pieces(0, rows, 0, cols):
            known[at_rows, at_cols] = masses[..., UNKNOWN] < 1.0
        return known


def _tiles_over(first: int, last: int) -> range:
    """Return the rows of the tiles that hold the rows of cells from `first` up to, and without, `last`."""
    return range(first // SIDE, -(-last // SIDE))


def vacuous_masses(rows: int, cols: int) -> Masses:
    """Return vacuous masses (rows, cols, 4)."""
    masses = np.empty((rows, cols, 4), dtype=np.float32)
    masses.view(np.complex128)[:] = _VACUOUS_CELL
    return masses
