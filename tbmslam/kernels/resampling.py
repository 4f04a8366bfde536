"""Cells of one grid read at the places of another's."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel


@kernel
def resample(
    masses: npt.NDArray[np.float32],
    row_of: npt.NDArray[np.float64],
    col_of: npt.NDArray[np.float64],
    samples: int,
    resampled: npt.NDArray[np.float32],
) -> None:
    """Write into every cell of `resampled` (rows, cols, 4) the mean of the cells of `masses` that it covers.

    A place (row, col) of the new grid, counted in cells from its outer corner, lies in the old grid at row
    ``row_of @ (row, col, 1)`` and column ``col_of @ (row, col, 1)``. Each new cell is read at ``samples`` x ``samples``
    places spread evenly over it; places outside the old grid are unknown.
    """
    old_rows, old_cols = masses.shape[0], masses.shape[1]
    for row in range(resampled.shape[0]):
        for col in range(resampled.shape[1]):
            if samples == 1:
                old_row = math.floor(row_of[0] * (row + 0.5) + row_of[1] * (col + 0.5) + row_of[2])
                old_col = math.floor(col_of[0] * (row + 0.5) + col_of[1] * (col + 0.5) + col_of[2])
                if 0 <= old_row < old_rows and 0 <= old_col < old_cols:
                    for subset in range(4):
                        resampled[row, col, subset] = masses[old_row, old_col, subset]
                else:
                    resampled[row, col, 0] = resampled[row, col, 1] = resampled[row, col, 2] = 0.0
                    resampled[row, col, 3] = 1.0
                continue
            conflict, free, occupied, unknown = 0.0, 0.0, 0.0, 0.0
            for sample in range(samples * samples):
                inner_row = row + (sample // samples + 0.5) / samples
                inner_col = col + (sample % samples + 0.5) / samples
                old_row = math.floor(row_of[0] * inner_row + row_of[1] * inner_col + row_of[2])
                old_col = math.floor(col_of[0] * inner_row + col_of[1] * inner_col + col_of[2])
                if 0 <= old_row < old_rows and 0 <= old_col < old_cols:
                    conflict += masses[old_row, old_col, 0]
                    free += masses[old_row, old_col, 1]
                    occupied += masses[old_row, old_col, 2]
                    unknown += masses[old_row, old_col, 3]
                else:
                    unknown += 1.0
            count = samples * samples
            resampled[row, col, 0] = conflict / count
            resampled[row, col, 1] = free / count
            resampled[row, col, 2] = occupied / count
            resampled[row, col, 3] = unknown / count
