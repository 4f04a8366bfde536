"""The place where a scan fits surface elements best, among all around a guess."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel
from tbmslam.kernels.surfels import CELLS, SIDE, FloatArray, Pose, Surfels, fit_surfel, layer_of, slot_of


@kernel
def search(
    surfels: Surfels,
    points: FloatArray,
    normals: FloatArray,
    guess: Pose,
    reach: int,
    turns: FloatArray,
    tolerance: float,
    costs: tuple[float, float],
) -> Pose:
    """Try every turn (K,) [rad] about the guess and every shift by up to `reach` cells; return the best pose.

    A point counts t^2 / (t^2 + d^2) of its Mahalanobis distance d; `costs` are the share of all points that a metre and
    a radian away from the guess must win, so that the nearest of equals is taken. A pose whose points do not even lie
    in enough cells with surfaces is not looked at more closely.
    """
    resolution = surfels.lattice.resolution
    bounds = _bounds(surfels, points, normals, guess, reach, turns).astype(np.float32)
    for k in range(len(turns)):
        for r in range(-reach, reach + 1):
            for c in range(-reach, reach + 1):
                away = costs[0] * resolution * math.hypot(r, c) + costs[1] * abs(turns[k])
                bounds[k, r + reach, c + reach] -= np.float32(away * len(points))
    first = int(np.argmax(bounds))
    best_score, best = -math.inf, (guess[0], guess[1], guess[2])
    flat, width = bounds.reshape(-1), 2 * reach + 1
    for number in range(-1, len(flat)):
        # The most promising one first: it rules most of the others out.
        candidate = first if number < 0 else number
        if number == first or flat[candidate] <= best_score:
            continue
        k, place = candidate // (width * width), candidate % (width * width)
        pose = (
            guess[0] + (place % width - reach) * resolution,
            guess[1] + (place // width - reach) * resolution,
            guess[2] + turns[k],
        )
        away = costs[0] * math.hypot(pose[0] - guess[0], pose[1] - guess[1]) + costs[1] * abs(turns[k])
        score = _matched(surfels, points, normals, pose, tolerance) - away * len(points)
        if score > best_score:
            best_score, best = score, pose
    return best


@kernel
def _may_hold(surfels: Surfels) -> npt.NDArray[np.uint8]:
    """Return 1 for every cell (2, rows, cols) that may have a surface."""
    tiles, _, fits, _, _ = surfels
    _, rows, cols = tiles.shape
    known = np.zeros((2, rows * SIDE, cols * SIDE), dtype=np.uint8)
    for layer in range(2):
        for row in range(rows):
            for col in range(cols):
                first = tiles[layer, row, col] * CELLS
                for cell in range(CELLS if first > 0 else 0):
                    if fits[first + cell, 5] != 0.0:
                        known[layer, row * SIDE + cell // SIDE, col * SIDE + cell % SIDE] = 1
    return known


@kernel
def _bounds(
    surfels: Surfels, points: FloatArray, normals: FloatArray, guess: Pose, reach: int, turns: FloatArray
) -> npt.NDArray[np.uint16]:
    """Return how many points lie in cells that may have a surface, (K, 2 reach + 1, 2 reach + 1): turns, rows, columns.

    The inner loop runs along memory on both sides.
    """
    resolution, first_row, first_col = surfels.lattice
    known = _may_hold(surfels)
    _, rows, cols = known.shape
    width = 2 * reach + 1
    bounds = np.zeros((len(turns), width, width), dtype=np.uint16)
    for k in range(len(turns)):
        cosine, sine = math.cos(guess[2] + turns[k]), math.sin(guess[2] + turns[k])
        for i in range(len(points)):
            px = guess[0] + cosine * points[i, 0] - sine * points[i, 1]
            py = guess[1] + sine * points[i, 0] + cosine * points[i, 1]
            layer = layer_of(
                cosine * normals[i, 0] - sine * normals[i, 1], sine * normals[i, 0] + cosine * normals[i, 1]
            )
            row = math.floor(py / resolution) - first_row - reach
            col = math.floor(px / resolution) - first_col - reach
            start, stop = max(0, -col), min(width, cols - col)
            for r in range(max(0, -row), min(width, rows - row)):
                for c in range(start, stop):
                    bounds[k, r, c] += known[layer, row + r, col + c]
    return bounds


@kernel
def _matched(surfels: Surfels, points: FloatArray, normals: FloatArray, pose: Pose, tolerance: float) -> float:
    """Return the sum of what points at a pose count."""
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
        if fits[slot, 5] < 0.0:
            fit_surfel(surfels, layer, row, col)
        dx, dy = px - fits[slot, 0], py - fits[slot, 1]
        distance = fits[slot, 2] * dx * dx + 2.0 * fits[slot, 3] * dx * dy + fits[slot, 4] * dy * dy
        matched += fits[slot, 5] * tolerance * tolerance / (tolerance * tolerance + distance)
    return matched
