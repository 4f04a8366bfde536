"""Sums of windows of cells: the scores of points for all shifts at once."""

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import part

BLOCK = 16
"""Number of cells that are added at once; the width of a window is a multiple of it."""


@part
def blocks_for(reach: int) -> int:
    """Return the width of a window for all shifts by up to `reach` cells, a multiple of the block [cells]."""
    return -(-(2 * reach + 1) // BLOCK) * BLOCK


@part
def add_window(
    sums: npt.NDArray[np.integer], cells: npt.NDArray[np.integer], first: int, stride: int, rows: int, cols: int
) -> None:
    """Add a window of (rows, cols) of ``cells``, which are stored row by row, to sums (rows * cols,).

    ``first`` is the index of the cell in the lowest corner of the window, and ``stride`` the number of cells in a row.
    """
    # Unsigned indices need no check for negative values, so the loop is vectorised.
    there, here = np.uint64(first), np.uint64(0)
    for _ in range(rows):
        for col in range(np.uint64(cols)):
            sums[here + col] += cells[there + col]
        there += np.uint64(stride)
        here += np.uint64(cols)
