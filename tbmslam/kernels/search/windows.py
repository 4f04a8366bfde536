"""Windows of cells added up: the same points seen under every shift at once."""

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel

BLOCK = 16
"""Cells that are added at once; windows are whole blocks wide."""


@kernel
def blocks_for(reach: int) -> int:
    """Return how many cells wide a window is that holds every shift by up to `reach` cells, in whole blocks."""
    return -(-(2 * reach + 1) // BLOCK) * BLOCK


@kernel
def add_window(
    sums: npt.NDArray[np.integer], cells: npt.NDArray[np.integer], first: int, stride: int, rows: int, cols: int
) -> None:
    """Add a window of cells to sums (rows * cols,).

    Parameters
    ----------
    cells
        All cells, row by row.
    first
        The one in the window's lowest corner.
    stride
        Cells in a row of all.
    rows, cols
        Size of the window.
    """
    # Negative indices count from the end. Unsigned ones need no check for that, so the loop is vectorised.
    there, here = np.uint64(first), np.uint64(0)
    for _ in range(rows):
        for col in range(np.uint64(cols)):
            sums[here + col] += cells[there + col]
        there += np.uint64(stride)
        here += np.uint64(cols)
