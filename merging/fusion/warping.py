"""Grids brought onto one lattice of cells: where the cells of a moved grid lie, and what they hold."""

import math

import numpy as np

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import PlacedGrid
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.map.map_check import LARGEST_CELL, MAX_CELLS, SMALLEST_CELL


class CellSizeError(TbmSlamError):
    """Maps cannot be brought into cells of such a size."""


def check_cell_size(resolution: float) -> None:
    """Check the side of a cell [m].

    Raises
    ------
    CellSizeError
        If no map has such cells.
    """
    if not SMALLEST_CELL <= resolution <= LARGEST_CELL:
        raise CellSizeError(
            f"cells of {resolution:g} m are not within {SMALLEST_CELL:g} to {LARGEST_CELL:g} m: correct the "
            "resolution of the maps, --resolution or --compare-at"
        )


def place(grid: TbmGrid, T_target_source: SE2, lattice: GridGeometry) -> PlacedGrid:
    """Lay a grid into another frame, on a window just large enough to hold all of it; nothing is drawn yet.

    Parameters
    ----------
    grid
        The source; cells that nobody saw are cut off at its edges first.
    T_target_source
        Pose of the source's frame in the target's frame.
    lattice
        Any grid of the target's frame: the result's cells continue its cells, whatever its size.

    Raises
    ------
    CellSizeError
        If the lattice's cells are far too large or small for the grid.
    """
    known = grid.known_part()
    return PlacedGrid(known, T_target_source, window_over(known.geometry, T_target_source, lattice))


def warp(grid: TbmGrid, T_target_source: SE2, lattice: GridGeometry) -> TbmGrid:
    """Resample a grid in another frame; see `place`."""
    return place(grid, T_target_source, lattice).drawn()


def at_resolution(grid: TbmGrid, resolution: float) -> TbmGrid:
    """Return the known part of a grid in cells of another size, in the same frame."""
    known = grid.cropped_to_known()
    if math.isclose(resolution, known.geometry.resolution, rel_tol=1e-6):
        return known
    return warp(known, SE2.identity(), known.geometry._replace(resolution=resolution))


def corners_of(source: GridGeometry, T_target_source: SE2) -> FloatArray:
    """Return the corners (4, 2) of a source grid in the frame it is placed in [m]."""
    left, bottom, right, top = source.bounds()
    return T_target_source.apply([(left, bottom), (right, bottom), (right, top), (left, top)])


def window_over(source: GridGeometry, T_target_source: SE2, lattice: GridGeometry) -> GridGeometry:
    """Return the smallest part of a lattice that covers a source grid placed in its frame."""
    left, bottom, right, top = source.bounds()
    corners = corners_of(source, T_target_source)
    check_cell_size(lattice.resolution)
    cells = (corners - (lattice.origin_x, lattice.origin_y)) / lattice.resolution
    sides = np.ptp(cells, axis=0)
    if not sides.prod() <= MAX_CELLS:
        raise CellSizeError(
            f"a map of {right - left:.3g} x {top - bottom:.3g} m is too large for cells of {lattice.resolution:g} m: "
            "pass coarser ones by --resolution and --compare-at, or correct the map's resolution"
        )
    # Rounding must not add a row of cells that the source does not reach.
    first = np.floor(cells.min(axis=0) + 1e-6).astype(int)
    last = np.ceil(cells.max(axis=0) - 1e-6).astype(int)
    return _window(lattice, first, last)


def canvas_over(windows: list[GridGeometry]) -> GridGeometry:
    """Return the smallest part of the windows' common lattice that covers all of them.

    Raises
    ------
    ValueError
        If there is none, or if they are not cut from one lattice.
    """
    if not windows:
        raise ValueError("windows must not be empty")
    offsets = np.array([offset_in(windows[0], window) for window in windows])
    sizes = np.array([(window.rows, window.cols) for window in windows])
    (top, left), (bottom, right) = offsets.min(axis=0), (offsets + sizes).max(axis=0)
    return _window(windows[0], np.array([left, top]), np.array([right, bottom]))


def offset_in(canvas: GridGeometry, window: GridGeometry) -> tuple[int, int]:
    """Return the (row, col) of a canvas at which a window of the same lattice begins.

    Raises
    ------
    ValueError
        If they are not cut from one lattice.
    """
    row = (window.origin_y - canvas.origin_y) / canvas.resolution
    col = (window.origin_x - canvas.origin_x) / canvas.resolution
    same_size = math.isclose(window.resolution, canvas.resolution, rel_tol=1e-6)
    if not same_size or abs(row - round(row)) > 1e-3 or abs(col - round(col)) > 1e-3:
        raise ValueError(f"grids must be cut from one lattice of cells, got {canvas} and {window}")
    return round(row), round(col)


def _window(lattice: GridGeometry, first: np.ndarray, last: np.ndarray) -> GridGeometry:
    """Return the lattice's cells from the (col, row) `first` up to, and without, `last`."""
    return GridGeometry(
        lattice.resolution,
        lattice.origin_x + float(first[0]) * lattice.resolution,
        lattice.origin_y + float(first[1]) * lattice.resolution,
        int(last[1] - first[1]),
        int(last[0] - first[0]),
    )
