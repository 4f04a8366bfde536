"""Resampling of a grid at the cells of another grid."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel, part

Cell = tuple[int, int]
"""A row and a column."""

_TILE = 16
"""Columns of a tile; reading a rotated grid tile by tile stays within a small part of memory."""


@kernel
def resample(
    masses: npt.NDArray[np.float32],
    corner: Cell,
    size: Cell,
    row_of: npt.NDArray[np.float64],
    col_of: npt.NDArray[np.float64],
    samples: int,
    first: Cell,
    resampled: npt.NDArray[np.float32],
) -> None:
    """Write into every cell of `resampled` (rows, cols, 4) the belief of the cells of the old grid that it covers.

    It is the belief of the most occupied one if that is rather occupied than free, otherwise their mean.

    `resampled` holds the new grid's cells from the row and column ``first`` on, and `masses` those of the old grid from
    the row and column ``corner`` on: all that are read. The old grid has ``size`` rows and columns.

    A place (row, col) of the new grid, counted in cells from its outer corner, lies in the old grid at row
    ``row_of @ (row, col, 1)`` and column ``col_of @ (row, col, 1)``. Each new cell is read at ``samples`` x ``samples``
    places spread evenly over it; places outside the old grid are unknown.
    """
    for left in range(0, resampled.shape[1], _TILE):
        right = min(left + _TILE, resampled.shape[1])
        for index in range(resampled.shape[0]):
            row = (first[0] + index, first[1])
            if samples == 1:
                _read_row(masses, corner, size, row_of, col_of, row, resampled[index], left, right)
            else:
                _summarise_row(masses, corner, size, row_of, col_of, samples, row, resampled[index], left, right)


@part
def _read_row(
    masses: npt.NDArray[np.float32],
    corner: Cell,
    size: Cell,
    row_of: npt.NDArray[np.float64],
    col_of: npt.NDArray[np.float64],
    first: Cell,
    resampled: npt.NDArray[np.float32],
    left: int,
    right: int,
) -> None:
    old_rows, old_cols = float(size[0]), float(size[1])
    row = first[0]
    for index in range(left, right):
        col = first[1] + index
        y = row_of[0] * (row + 0.5) + row_of[1] * (col + 0.5) + row_of[2]
        x = col_of[0] * (row + 0.5) + col_of[1] * (col + 0.5) + col_of[2]
        if 0.0 <= y < old_rows and 0.0 <= x < old_cols:
            old_row, old_col = int(y) - corner[0], int(x) - corner[1]
            for subset in range(4):
                resampled[index, subset] = masses[old_row, old_col, subset]
        else:
            resampled[index, 0] = resampled[index, 1] = resampled[index, 2] = 0.0
            resampled[index, 3] = 1.0


@part
def _summarise_row(
    masses: npt.NDArray[np.float32],
    corner: Cell,
    size: Cell,
    row_of: npt.NDArray[np.float64],
    col_of: npt.NDArray[np.float64],
    samples: int,
    first: Cell,
    resampled: npt.NDArray[np.float32],
    left: int,
    right: int,
) -> None:
    old_rows, old_cols = size
    row = first[0]
    for index in range(left, right):
        col = first[1] + index
        conflict, free, occupied, unknown = 0.0, 0.0, 0.0, 0.0
        most, wall_row, wall_col = 0.0, 0, 0
        for sample in range(samples * samples):
            inner_row = row + (sample // samples + 0.5) / samples
            inner_col = col + (sample % samples + 0.5) / samples
            old_row = math.floor(row_of[0] * inner_row + row_of[1] * inner_col + row_of[2])
            old_col = math.floor(col_of[0] * inner_row + col_of[1] * inner_col + col_of[2])
            if 0 <= old_row < old_rows and 0 <= old_col < old_cols:
                at_row, at_col = old_row - corner[0], old_col - corner[1]
                conflict += masses[at_row, at_col, 0]
                free += masses[at_row, at_col, 1]
                occupied += masses[at_row, at_col, 2]
                unknown += masses[at_row, at_col, 3]
                if masses[at_row, at_col, 2] > max(masses[at_row, at_col, 1], most):
                    most, wall_row, wall_col = masses[at_row, at_col, 2], at_row, at_col
            else:
                unknown += 1.0
        if most > 0.0:
            for subset in range(4):
                resampled[index, subset] = masses[wall_row, wall_col, subset]
            continue
        count = samples * samples
        resampled[index, 0] = conflict / count
        resampled[index, 1] = free / count
        resampled[index, 2] = occupied / count
        resampled[index, 3] = unknown / count
