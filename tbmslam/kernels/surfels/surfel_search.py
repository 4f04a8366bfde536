"""Exhaustive search for the pose of a scan on surfels around a guess."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, Pose, kernel, part
from tbmslam.kernels.arrays import cleared
from tbmslam.kernels.search.windows import add_window, blocks_for
from tbmslam.kernels.surfels.surfels import CELLS, SIDE, SurfelArrays, fit_surfel, layer_of, slot_of


@kernel
def search(
    surfels: SurfelArrays,
    points: FloatArray,
    normals: FloatArray,
    guess: Pose,
    reach: int,
    turns: FloatArray,
    tolerance: float,
    costs: tuple[float, float],
) -> Pose:
    """Try every turn (K,) [rad] about the guess and every shift by up to `reach` cells; return the best pose.

    A point with Mahalanobis distance d scores t^2 / (t^2 + d^2) for the tolerance t. `costs` are the shares of all
    points that the score must gain for a metre and for a radian away from the guess, so the nearest of equal poses is
    taken. Poses with too few points in cells with surfaces are not scored.
    """
    resolution, width = surfels[3][0], 2 * reach + 1
    counts = _bounds(surfels, points, normals, guess, reach, turns)
    shifted, size = np.empty((width, width)), width * width
    for row in range(width):
        for col in range(width):
            shifted[row, col] = costs[0] * resolution * math.hypot(row - reach, col - reach)
    bounds, first = np.empty(len(turns) * size, dtype=np.float32), 0
    for k in range(len(turns)):
        turned = costs[1] * abs(turns[k])
        for row in range(width):
            for col in range(width):
                at = k * size + row * width + col
                bounds[at] = counts[k, row, col] - (shifted[row, col] + turned) * len(points)
                if bounds[at] > bounds[first]:
                    first = at
    best_score, best = -math.inf, (guess[0], guess[1], guess[2])
    for is_rest in range(2):
        # The first candidate excludes most of the others.
        candidates = np.empty(1, dtype=np.int64)
        candidates[0] = first
        if is_rest:
            candidates = _most_promising_first(bounds, best_score)
        for candidate in candidates:
            if bounds[candidate] <= best_score:
                continue
            turn, place = candidate // size, candidate % size
            pose = (
                guess[0] + (place % width - reach) * resolution,
                guess[1] + (place // width - reach) * resolution,
                guess[2] + turns[turn],
            )
            away = costs[0] * math.hypot(pose[0] - guess[0], pose[1] - guess[1]) + costs[1] * abs(turns[turn])
            spare = bounds[candidate] - best_score + 0.001  # a bound has seven digits
            score = _matched(surfels, points, normals, pose, tolerance, spare) - away * len(points)
            if score > best_score:
                best_score, best = score, pose
    return best


@part
def _most_promising_first(bounds: npt.NDArray[np.float32], least: float) -> npt.NDArray[np.int64]:
    """Return the indices of bounds (N,) above a value, larger ones first, sorted by their integer parts.

    An early good pose excludes many other poses.
    """
    lowest, highest, count = math.inf, -math.inf, 0
    for bound in bounds:
        if bound > least:
            lowest, highest, count = min(lowest, bound), max(highest, bound), count + 1
    order = np.empty(count, dtype=np.int64)
    if count == 0:
        return order
    top = math.floor(highest)
    begins = cleared(np.empty(top - math.floor(lowest) + 2, dtype=np.int64))
    for bound in bounds:
        if bound > least:
            begins[top - math.floor(bound) + 1] += 1
    for place in range(1, len(begins)):
        begins[place] += begins[place - 1]
    for place in range(len(bounds)):
        if bounds[place] > least:
            bucket = top - math.floor(bounds[place])
            order[begins[bucket]] = place
            begins[bucket] += 1
    return order


@part
def _may_hold(surfels: SurfelArrays, margin: int) -> npt.NDArray[np.uint8]:
    """Return 1 for every cell (2, rows, cols) that may have a surface, with a margin on every side."""
    tiles, _, fits, _, _ = surfels
    _, rows, cols = tiles.shape
    known = cleared(np.empty((2, rows * SIDE + 2 * margin, cols * SIDE + 2 * margin), dtype=np.uint8))
    for layer in range(2):
        for row in range(rows):
            for col in range(cols):
                first = tiles[layer, row, col] * CELLS
                for cell in range(CELLS if first > 0 else 0):
                    if fits[first + cell, 5] != 0.0:
                        r, c = margin + row * SIDE + cell // SIDE, margin + col * SIDE + cell % SIDE
                        known[layer, r, c] = 1
    return known


@part
def _bounds(
    surfels: SurfelArrays, points: FloatArray, normals: FloatArray, guess: Pose, reach: int, turns: FloatArray
) -> npt.NDArray[np.uint16]:
    """Return the number of points in cells that may have a surface, (K, 2 reach + 1, 2 reach + 1 or more).

    The axes are turns, shifts by rows, and shifts by columns.
    """
    resolution, first_row, first_col = surfels[3]
    width, margin = 2 * reach + 1, blocks_for(reach)
    known = _may_hold(surfels, margin)
    cells, (_, rows, cols) = known.reshape(-1), known.shape
    bounds = cleared(np.empty((len(turns), width, margin), dtype=np.uint16))
    for k in range(len(turns)):
        counts = bounds[k].reshape(-1)
        cosine, sine = math.cos(guess[2] + turns[k]), math.sin(guess[2] + turns[k])
        for i in range(len(points)):
            px = guess[0] + cosine * points[i, 0] - sine * points[i, 1]
            py = guess[1] + sine * points[i, 0] + cosine * points[i, 1]
            row = math.floor(py / resolution) - first_row - reach + margin
            col = math.floor(px / resolution) - first_col - reach + margin
            if row < 0 or col < 0 or row + width > rows or col + margin > cols:
                continue
            nx, ny = normals[i, 0], normals[i, 1]
            layer = layer_of(cosine * nx - sine * ny, sine * nx + cosine * ny)
            add_window(counts, cells, (layer * rows + row) * cols + col, cols, width, margin)
    return bounds


@part
def _matched(
    surfels: SurfelArrays, points: FloatArray, normals: FloatArray, pose: Pose, tolerance: float, spare: float
) -> float:
    """Return the score of points at a pose; -inf as soon as points on surfaces lose more than `spare`."""
    tiles, _, fits, lattice, _ = surfels
    resolution, first_row, first_col = lattice
    rows, cols = tiles.shape[1] * SIDE, tiles.shape[2] * SIDE
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    matched = 0.0
    for i in range(len(points)):
        px = pose[0] + cosine * points[i, 0] - sine * points[i, 1]
        py = pose[1] + sine * points[i, 0] + cosine * points[i, 1]
        col = math.floor(px / resolution) - first_col
        row = math.floor(py / resolution) - first_row
        if row < 0 or col < 0 or row >= rows or col >= cols:
            continue
        layer = layer_of(cosine * normals[i, 0] - sine * normals[i, 1], sine * normals[i, 0] + cosine * normals[i, 1])
        slot = slot_of(tiles, layer, row, col)
        if fits[slot, 5] == 0.0:
            continue
        if fits[slot, 5] < 0.0:
            fit_surfel(surfels, layer, row, col)
        dx, dy = px - fits[slot, 0], py - fits[slot, 1]
        distance = fits[slot, 2] * dx * dx + 2.0 * fits[slot, 3] * dx * dy + fits[slot, 4] * dy * dy
        counts = fits[slot, 5] * tolerance * tolerance / (tolerance * tolerance + distance)
        matched += counts
        spare -= 1.0 - counts
        if spare < 0.0:
            return -math.inf
    return matched
