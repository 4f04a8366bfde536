"""Updates of the evidence of the cells that beams pass and end in.

Cells are indexed on the lattice of `tbmslam.belief.evidence_grid`: column floor(x / resolution), row
floor(y / resolution).
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, kernel, part
from tbmslam.kernels.rays.lattice import Lattice

RATIO_LIMIT = 1e150
"""Larger evidence is rescaled, so that products do not overflow; such evidence is certain."""


class BeamFactors(NamedTuple):
    """Factors by which one beam multiplies the evidence a_F and a_O of a cell, or summands."""

    hit: FloatArray
    """(2,) for the end cell of a beam."""
    miss: FloatArray
    """(2,) for a passed cell."""
    blur: FloatArray
    """(B, 2) for a passed cell near the end cell, indexed by their squared distance [cells^2]."""
    blur_radius_squared: float
    """The square of the length of the blur [cells^2]; shorter beams are not blurred."""
    adds: bool = False
    """Whether the factors are summands."""


@part
def walk_beam(x0: float, y0: float, x1: float, y1: float, resolution: float, cells: npt.NDArray[np.int64]) -> int:
    """Write the lattice cells (M, 2) as (row, col) that a beam touches, from its start to its end; return their number.

    The walk is 4-connected and steps to the neighbour with the nearer centre, or diagonally if both are equally near
    (vinySLAM). `cells` needs |rows| + |cols| + 2 entries.
    """
    row, col = math.floor(y0 / resolution), math.floor(x0 / resolution)
    end_row, end_col = math.floor(y1 / resolution), math.floor(x1 / resolution)
    dx, dy = x1 - x0, y1 - y0
    row_step = 1 if dy > 0.0 else -1
    col_step = 1 if dx > 0.0 else -1
    longest = abs(end_row - row) + abs(end_col - col) + 1
    # dx times the height of the beam over the cell's centre, at the centre's x
    error = dx * (y0 - (row + 0.5) * resolution) + dy * ((col + 0.5) * resolution - x0)
    col_change, row_change = dy * col_step * resolution, dx * row_step * resolution
    cells[0, 0], cells[0, 1] = row, col
    count = 1
    while row != end_row or col != end_col:
        if count >= longest:
            return _walk_bresenham(cells, end_row, end_col)
        after_col, after_row = abs(error + col_change), abs(error - row_change)
        if abs(after_col - after_row) <= 1e-7 * max(1.0, after_col, after_row):
            if col != end_col:
                col += col_step
            if row != end_row:
                row += row_step
            error = 0.0
        else:
            # The processor could not predict a branch here.
            by_row = after_row < after_col
            row += row_step if by_row else 0
            col += 0 if by_row else col_step
            error = error - row_change if by_row else error + col_change
        cells[count, 0], cells[count, 1] = row, col
        count += 1
    return count


@part
def _walk_bresenham(cells: npt.NDArray[np.int64], end_row: int, end_col: int) -> int:
    """Write an 8-connected walk from `cells[0]`, for the rare beam whose 4-connected walk misses its end cell."""
    row, col = cells[0, 0], cells[0, 1]
    row_span, col_span = abs(end_row - row), abs(end_col - col)
    row_step = 1 if end_row > row else -1
    col_step = 1 if end_col > col else -1
    error = col_span - row_span
    count = 1
    while row != end_row or col != end_col:
        doubled = 2 * error
        if doubled > -row_span:
            error -= row_span
            col += col_step
        if doubled < col_span:
            error += col_span
            row += row_step
        cells[count, 0], cells[count, 1] = row, col
        count += 1
    return count


@kernel
def beams_of_scan(
    ranges: FloatArray,
    directions: tuple[float, float],
    beam_step: tuple[float, float, float],
    pose: tuple[float, float, float],
    limits: tuple[float, float],
    clears: bool,
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_], FloatArray]:
    """Return the usable beams of a scan for `insert_beams`, and the corners of their bounding box.

    Parameters
    ----------
    ranges
        Distances (N,), coded as in `LaserScan` [m].
    directions
        Direction of the first beam, and the step between beams, in the laser's frame [rad].
    beam_step
        Motion of the laser from one beam to the next.
    pose
        Pose of the laser at the first beam.
    limits
        Largest range of a hit, beyond which it only clears space, and largest range of cleared space [m].
    clears
        Whether beams without a return clear the space up to their limit.

    Returns
    -------
    Starts (M, 2), or (1, 2) if the laser did not move; ends (M, 2); whether each is a hit (M,); lower and upper corner
    (2, 2).
    """
    starts, ends = np.empty((len(ranges), 2)), np.empty((len(ranges), 2))
    is_hit = np.empty(len(ranges), dtype=np.bool_)
    still = beam_step[0] == 0.0 and beam_step[1] == 0.0
    x, y, count = pose[0], pose[1], 0
    # The direction rotates from beam to beam, as in `hit_points`.
    cosine, sine = math.cos(pose[2] + directions[0]), math.sin(pose[2] + directions[0])
    turn = directions[1] + beam_step[2]
    turn_cosine, turn_sine = math.cos(turn), math.sin(turn)
    step_x = math.cos(pose[2]) * beam_step[0] - math.sin(pose[2]) * beam_step[1]
    step_y = math.sin(pose[2]) * beam_step[0] + math.cos(pose[2]) * beam_step[1]
    sway_cosine, sway_sine = math.cos(beam_step[2]), math.sin(beam_step[2])
    corners = np.array([[x, y], [x, y]])
    for i in range(len(ranges)):
        length = ranges[i]
        if math.isfinite(length) or (clears and length == math.inf):
            is_hit[count] = length <= limits[0] and length != math.inf
            if not is_hit[count]:
                length = min(length, limits[1])
            starts[count, 0], starts[count, 1] = x, y
            ends[count, 0], ends[count, 1] = x + length * cosine, y + length * sine
            for k in range(2):
                corners[0, k] = min(corners[0, k], starts[count, k], ends[count, k])
                corners[1, k] = max(corners[1, k], starts[count, k], ends[count, k])
            count += 1
        cosine, sine = cosine * turn_cosine - sine * turn_sine, sine * turn_cosine + cosine * turn_sine
        if not still:
            x, y = x + step_x, y + step_y
            step_x, step_y = step_x * sway_cosine - step_y * sway_sine, step_y * sway_cosine + step_x * sway_sine
    return starts[: min(count, 1) if still else count], ends[:count], is_hit[:count], corners


@kernel
def insert_beams(
    ratios: FloatArray,
    lattice: Lattice,
    starts: FloatArray,
    ends: FloatArray,
    is_hit: npt.NDArray[np.bool_],
    factors: BeamFactors,
) -> None:
    """Combine the evidence of beams into `ratios` (rows, cols, 2), which must contain all of them.

    Every beam updates each of its cells once: the end cell of a hit as hit, all other cells as passed. Passed cells
    near a hit are blurred. The beams have origins (N, 2) [m], or (1, 2) for all beams, and end points (N, 2) [m].
    """
    resolution, first_row, first_col = lattice
    cells = np.empty((ratios.shape[0] + ratios.shape[1] + 2, 2), dtype=np.int64)
    hit_free, hit_occupied = factors.hit[0], factors.hit[1]
    miss_free, miss_occupied = factors.miss[0], factors.miss[1]
    blur_radius_squared, adds = factors.blur_radius_squared, factors.adds
    for beam in range(len(ends)):
        x, y = starts[beam % len(starts), 0], starts[beam % len(starts), 1]
        count = walk_beam(x, y, ends[beam, 0], ends[beam, 1], resolution, cells)
        end_row, end_col = cells[count - 1, 0], cells[count - 1, 1]
        length_squared = (cells[0, 0] - end_row) ** 2 + (cells[0, 1] - end_col) ** 2
        blurred = count - 1
        if is_hit[beam]:
            _combine(ratios, end_row - first_row, end_col - first_col, hit_free, hit_occupied, adds)
            if blur_radius_squared < length_squared:
                # The distance to the end decreases along the walk, so the blurred cells are the last ones.
                while blurred > 0:
                    distance_squared = (cells[blurred - 1, 0] - end_row) ** 2 + (cells[blurred - 1, 1] - end_col) ** 2
                    if distance_squared >= blur_radius_squared:
                        break
                    blurred -= 1
                    _combine(
                        ratios,
                        cells[blurred, 0] - first_row,
                        cells[blurred, 1] - first_col,
                        factors.blur[distance_squared, 0],
                        factors.blur[distance_squared, 1],
                        adds,
                    )
        else:
            _combine(ratios, end_row - first_row, end_col - first_col, miss_free, miss_occupied, adds)
        for i in range(blurred):
            _combine(ratios, cells[i, 0] - first_row, cells[i, 1] - first_col, miss_free, miss_occupied, adds)


@part
def _combine(ratios: FloatArray, row: int, col: int, free_factor: float, occupied_factor: float, adds: bool) -> None:
    if adds:
        ratios[row, col, 0] += free_factor
        ratios[row, col, 1] += occupied_factor
        return
    free, occupied = ratios[row, col, 0] * free_factor, ratios[row, col, 1] * occupied_factor
    if free > RATIO_LIMIT or occupied > RATIO_LIMIT:
        free, occupied = max(free * 1e-50, 1.0), max(occupied * 1e-50, 1.0)
    ratios[row, col, 0], ratios[row, col, 1] = free, occupied
