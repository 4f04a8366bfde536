"""Many maps of one place that are mostly the same: they share square tiles, and copy one when they write into it."""

import numpy as np
import numpy.typing as npt

from tbmslam.belief.evidence_grid import GridTooLargeError
from tbmslam.kernels.grids.tiles import TILE, TileGrid, write_cells
from tbmslam.kernels.rays.insertion import BeamFactors

_FIRST_TILES = 64


class TileMaps:
    """As many evidence grids as there are particles.

    Parameters
    ----------
    count
        How many maps.
    resolution
        Side of a cell [m].
    max_cells
        Cells of all maps' tiles together beyond which writing is refused; a cell takes 8 bytes.
    """

    def __init__(self, count: int, resolution: float, max_cells: int = 200_000_000) -> None:
        self.resolution = resolution
        self._max_cells = max_cells
        self._first_row, self._first_col = 0, 0
        self._places = np.zeros((count, 0, 0), dtype=np.int32)
        self._tiles = np.ones((1, TILE, TILE, 2), dtype=np.float32)  # tile 0 is the vacuous one
        self._references = np.zeros(1, dtype=np.int64)
        self._free = np.zeros(0, dtype=np.int32)
        self._free_count = 0

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self._places)

    @property
    def tiles_in_use(self) -> int:
        """How many tiles the maps hold in memory together."""
        return len(self._tiles) - 1 - self._free_count

    def grid(self, number: int) -> TileGrid:
        """Return one of the maps as kernels read it; it is good until something is written."""
        return TileGrid(self._tiles, self._places[number], self.resolution, self._first_row, self._first_col)

    def insert(
        self, number: int, cells: npt.NDArray[np.int32], is_hit: npt.NDArray[np.bool_], factors: BeamFactors
    ) -> None:
        """Combine evidence into one of the maps.

        Parameters
        ----------
        number
            Which map.
        cells
            Lattice cells (M, 2), each once.
        is_hit
            Whether they (M,) were hit, or passed.
        factors
            Factors of a hit and of a passage.

        Raises
        ------
        GridTooLargeError
            When the maps together would pass `max_cells`.
        """
        if len(cells) == 0:
            return
        rows, cols = cells.T
        low = np.array([rows.min(), cols.min()]) // TILE
        high = np.array([rows.max(), cols.max()]) // TILE
        self._grow_places(low, high)
        self._provide(int(np.prod(high - low + 1)))
        self._free_count = write_cells(
            self.grid(number), self._references, self._free, self._free_count, cells, is_hit, factors
        )

    def resample(self, ancestors: npt.NDArray[np.int64]) -> None:
        """Replace every map by the one of its ancestor (N,); tiles without a map become free."""
        self._places = self._places[ancestors]
        self._references = np.bincount(self._places.ravel(), minlength=len(self._tiles))
        self._free = (np.flatnonzero(self._references[1:] == 0)[::-1] + 1).astype(np.int32)
        self._free_count = len(self._free)

    def _grow_places(self, low: npt.NDArray[np.int32], high: npt.NDArray[np.int32]) -> None:
        """Let the maps reach from tile (row, col) `low` to `high`."""
        count, rows, cols = self._places.shape
        if rows == 0:
            self._first_row, self._first_col = int(low[0]), int(low[1])
        first_row, first_col = min(self._first_row, int(low[0])), min(self._first_col, int(low[1]))
        stop_row, stop_col = (
            max(self._first_row + rows, int(high[0]) + 1),
            max(self._first_col + cols, int(high[1]) + 1),
        )
        if (stop_row - first_row, stop_col - first_col) == (rows, cols):
            return
        grown = np.zeros((count, stop_row - first_row, stop_col - first_col), dtype=np.int32)
        top, left = self._first_row - first_row, self._first_col - first_col
        grown[:, top : top + rows, left : left + cols] = self._places
        self._places, self._first_row, self._first_col = grown, first_row, first_col
        self._references[0] = np.count_nonzero(grown == 0)

    def _provide(self, needed: int) -> None:
        """Enlarge the pool until so many tiles are free."""
        if self._free_count >= needed:
            return
        before = len(self._tiles)
        extra = max(needed - self._free_count, before // 2, _FIRST_TILES)
        if (before + extra) * TILE**2 > self._max_cells:
            raise GridTooLargeError(
                f"the maps of {len(self)} particles would take {before + extra} tiles of {TILE} x {TILE} cells, more "
                f"than the limit of {self._max_cells} cells: use fewer tracker.particles, a coarser map.resolution or "
                "a shorter tracker.max_range, or raise map.max_cells"
            )
        self._tiles = np.concatenate((self._tiles, np.empty((extra, TILE, TILE, 2), dtype=np.float32)))
        self._references = np.concatenate((self._references, np.zeros(extra, dtype=np.int64)))
        fresh = np.arange(before + extra - 1, before - 1, -1, dtype=np.int32)
        self._free = np.concatenate((fresh, self._free[: self._free_count]))
        self._free_count += extra
