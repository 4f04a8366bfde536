"""Every shift and turn of a scan over a field at once."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel
from tbmslam.kernels.lattice import Lattice

FloatArray = npt.NDArray[np.float64]
Field = npt.NDArray[np.float32]
Pose = tuple[float, float, float]


@kernel
def correlate(field: Field, lattice: Lattice, points: FloatArray, guess: Pose, turns: FloatArray, reach: int) -> Field:
    """Return the sum of the field under points (N, 2) for every turn and every shift by whole cells.

    Outside the field counts as zero.

    Parameters
    ----------
    field
        Values (rows, cols) of the cells.
    guess
        Pose of the points' frame that is turned and shifted.
    turns
        Turns (K,) about the guess [rad].
    reach
        Largest shift along an axis [cells].

    Returns
    -------
    Sums (K, 2 reach + 1, 2 reach + 1); the second axis shifts rows and the third columns, from -reach to reach.
    """
    resolution, first_row, first_col = lattice
    rows, cols = field.shape
    width = 2 * reach + 1
    sums = np.zeros((len(turns), width, width), dtype=np.float32)
    for k in range(len(turns)):
        theta = guess[2] + turns[k]
        cosine, sine = math.cos(theta), math.sin(theta)
        for i in range(len(points)):
            x = guess[0] + cosine * points[i, 0] - sine * points[i, 1]
            y = guess[1] + sine * points[i, 0] + cosine * points[i, 1]
            row = math.floor(y / resolution) - first_row - reach
            col = math.floor(x / resolution) - first_col - reach
            # The part of the window that lies on the field; its inner loop runs along memory on both sides.
            row_start, row_stop = max(0, -row), min(width, rows - row)
            col_start, col_stop = max(0, -col), min(width, cols - col)
            for r in range(row_start, row_stop):
                for c in range(col_start, col_stop):
                    sums[k, r, c] += field[row + r, col + c]
    return sums
