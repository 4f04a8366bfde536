"""Correlative scan matching: the score of points for every rotation and translation over a grid of scores."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, Pose, kernel
from tbmslam.kernels.arrays import cleared
from tbmslam.kernels.rays.counting import Counts, hits_in, passages_in
from tbmslam.kernels.rays.lattice import PlainLattice
from tbmslam.kernels.search.windows import add_window, blocks_for

GainField = npt.NDArray[np.int8]
Sums = npt.NDArray[np.int32]


WALL = 100
"""Score of a point on a wall."""

SHORT_SUM = 255
"""Number of points whose sum of scores always fits into 16 bits."""


@kernel
def search_field(counts: Counts, free_penalty: float) -> GainField:
    """Return the score of a point in every cell (rows, cols), from counts as in `count_scans`.

    The score is `WALL` in cells that a scan hit and in their neighbours, -`free_penalty` * `WALL` in cells that two
    scans passed, and 0 elsewhere.
    """
    rows, cols = counts.shape
    field = cleared(np.empty((rows, cols), dtype=np.int8))
    free = np.int8(-round(free_penalty * WALL))
    for row in range(rows):
        for col in range(cols):
            if passages_in(counts[row, col]) > 1:
                field[row, col] = free
    for row in range(rows):
        for col in range(cols):
            if hits_in(counts[row, col]) > 0:
                for near_row in range(max(row - 1, 0), min(row + 2, rows)):
                    for near_col in range(max(col - 1, 0), min(col + 2, cols)):
                        field[near_row, near_col] = WALL
    return field


@kernel
def coarser_field(field: GainField, lattice: PlainLattice) -> tuple[GainField, PlainLattice]:
    """Return a field with cells of twice the size, each with the maximum of its cells, and its lattice."""
    resolution, first_row, first_col = lattice
    rows, cols = field.shape
    top, left = first_row // 2, first_col // 2
    height, width = (first_row + rows - 1) // 2 - top + 1, (first_col + cols - 1) // 2 - left + 1
    coarse = np.empty((height, width), dtype=np.int8)
    coarse[...] = -128
    for row in range(rows):
        for col in range(cols):
            r, c = (first_row + row) // 2 - top, (first_col + col) // 2 - left
            coarse[r, c] = max(coarse[r, c], field[row, col])
    return coarse, (2.0 * resolution, top, left)


@kernel
def share_in_free_space(field: GainField, lattice: PlainLattice, points: FloatArray, pose: Pose) -> float:
    """Return the share of points (N, 2), transformed by a pose, that lie in cells with a negative score."""
    resolution, first_row, first_col = lattice
    rows, cols = field.shape
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    free = 0
    for i in range(len(points)):
        col = math.floor((pose[0] + cosine * points[i, 0] - sine * points[i, 1]) / resolution) - first_col
        row = math.floor((pose[1] + sine * points[i, 0] + cosine * points[i, 1]) / resolution) - first_row
        if 0 <= row < rows and 0 <= col < cols and field[row, col] < 0:
            free += 1
    return free / max(len(points), 1)


@kernel
def top_places(sums: Sums, cost: float, clear: int, count: int) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Return the largest sums (count,), best first, and their indices (count, 3): turn, row, column.

    The sum decreases by `cost` per cell of distance from the centre. The indices are more than `clear` cells apart
    along an axis. If fewer exist, the remaining sums are -inf.
    """
    turns, width, _ = sums.shape
    reach = width // 2
    top = np.empty((width, width))
    top[...] = -np.inf
    turn = cleared(np.empty((width, width), dtype=np.int64))
    for k in range(turns):
        for row in range(width):
            for col in range(width):
                if sums[k, row, col] > top[row, col]:
                    top[row, col], turn[row, col] = sums[k, row, col], k
    for row in range(width):
        for col in range(width):
            top[row, col] -= cost * math.hypot(row - reach, col - reach)
    scores, places = np.empty(count), cleared(np.empty((count, 3), dtype=np.int64))
    scores[:] = -np.inf
    for number in range(count):
        for row in range(width):
            for col in range(width):
                if top[row, col] > scores[number]:
                    scores[number] = top[row, col]
                    places[number, 0], places[number, 1], places[number, 2] = turn[row, col], row, col
        at_row, at_col = places[number, 1], places[number, 2]
        for row in range(max(at_row - clear, 0), min(at_row + clear + 1, width)):
            for col in range(max(at_col - clear, 0), min(at_col + clear + 1, width)):
                top[row, col] = -np.inf
    return scores, places


@kernel
def correlate(
    field: GainField, lattice: PlainLattice, points: FloatArray, guess: Pose, turns: FloatArray, reach: int
) -> Sums:
    """Return the sum of the field at points (N, 2) for every turn and every shift by whole cells.

    The field (rows, cols) is zero outside its cells. `guess` is the initial pose of the points' frame, `turns` (K,) are
    relative to it [rad], and `reach` is the largest shift along an axis [cells]. The second axis of the sums (K, 2
    reach + 1, 2 reach + 1) shifts rows and the third columns, from -reach to reach.
    """
    resolution, first_row, first_col = lattice
    rows, cols = field.shape
    width, margin = 2 * reach + 1, blocks_for(reach)
    # A border of zeros makes checks of single points unnecessary.
    wide = cleared(np.empty((rows + 2 * margin, cols + 2 * margin), dtype=np.int8))
    for row in range(rows):
        for col in range(cols):
            wide[margin + row, margin + col] = field[row, col]
    cells, (wide_rows, wide_cols) = wide.reshape(-1), wide.shape
    sums = cleared(np.empty((len(turns), width, width), dtype=np.int32))
    few = np.empty(width * margin, dtype=np.int16)
    for k in range(len(turns)):
        theta = guess[2] + turns[k]
        cosine, sine = math.cos(theta), math.sin(theta)
        for first in range(0, len(points), SHORT_SUM):
            for cell in range(len(few)):
                few[cell] = 0
            for i in range(first, min(first + SHORT_SUM, len(points))):
                x = guess[0] + cosine * points[i, 0] - sine * points[i, 1]
                y = guess[1] + sine * points[i, 0] + cosine * points[i, 1]
                row = math.floor(y / resolution) - first_row - reach + margin
                col = math.floor(x / resolution) - first_col - reach + margin
                if row >= 0 and col >= 0 and row + width <= wide_rows and col + margin <= wide_cols:
                    add_window(few, cells, row * wide_cols + col, wide_cols, width, margin)
            for r in range(width):
                for c in range(width):
                    sums[k, r, c] += few[r * margin + c]
    return sums
