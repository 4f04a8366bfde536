"""Grids of evidence with shared square tiles: the likelihood of scans, and updates.

A grid is an array (rows, cols) of indices into a pool of tiles. Tile 0 is vacuous and never written. A tile of more
than one grid is copied before it is written.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, Pose, kernel
from tbmslam.kernels.rays.insertion import BeamFactors

Tiles = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]

TILE_BITS = 6
TILE = 1 << TILE_BITS
"""Side of a tile [cells]."""
_RATIO_LIMIT = 1e30
_LEAST = 0.02  # smaller masses on OCCUPIED are ignored
_REACH_SQUARED = 1.5  # largest squared distance from a hit to the centre of a cell; no corners of 3 x 3 [cells^2]


class TileGrid(NamedTuple):
    """A grid of tiles."""

    tiles: Tiles
    """The pool (N, TILE, TILE, 2): a_F and a_O of every cell, as in `tbmslam.belief.evidence_grid`."""
    places: Index
    """The index (rows, cols) of each tile in the pool."""
    resolution: float
    first_row: int
    """Lattice index of the first tile's first cell, in tiles."""
    first_col: int


class HitModel(NamedTuple):
    """The likelihood of a hit in a grid, relative to 1 on a certain wall."""

    gain: float
    """Exponent of the likelihood of each hit, since neighbouring beams are not independent."""
    clutter: float
    """Likelihood of a hit in free space."""
    unknown: float
    """Likelihood of a hit in an unknown cell."""
    spread: float
    """Standard deviation of a hit from the centre of its cell [cells]."""


@kernel
def log_likelihood(grid: TileGrid, points: FloatArray, pose: Pose, model: HitModel) -> float:
    """Return the log likelihood of hits (N, 2) [m], transformed by the pose of their frame.

    The likelihood of a hit is that of its best cell in 3 x 3: the cell's mass on OCCUPIED times a Gaussian of the
    distance from its centre (as in Grisetti, Stachniss, Burgard 2007).
    """
    x, y, theta = pose
    cosine, sine = math.cos(theta) / grid.resolution, math.sin(theta) / grid.resolution
    x, y = x / grid.resolution, y / grid.resolution
    exponent = -0.5 / model.spread**2
    total = 0.0
    for i in range(len(points)):
        px, py = points[i, 0], points[i, 1]
        col_at, row_at = x + cosine * px - sine * py, y + sine * px + cosine * py
        col, row = math.floor(col_at), math.floor(row_at)
        near, unknown = _nearest_wall(grid, row, col, row_at, col_at, exponent)
        total += math.log(model.clutter + (1.0 - model.clutter) * max(near, model.unknown * unknown))
    return total * model.gain


@kernel
def _nearest_wall(
    grid: TileGrid, row: int, col: int, row_at: float, col_at: float, exponent: float
) -> tuple[float, float]:
    """Return the best product of mass on OCCUPIED and Gaussian for a point, and the mass of its cell on UNKNOWN."""
    tile_row, tile_col = (row >> TILE_BITS) - grid.first_row, (col >> TILE_BITS) - grid.first_col
    if tile_row < 0 or tile_col < 0 or tile_row >= grid.places.shape[0] or tile_col >= grid.places.shape[1]:
        return 0.0, 1.0
    tile = grid.tiles[grid.places[tile_row, tile_col]]
    inside_row, inside_col = row & (TILE - 1), col & (TILE - 1)
    unknown = 1.0 / (tile[inside_row, inside_col, 0] + tile[inside_row, inside_col, 1] - 1.0)
    near = _LEAST
    for r in range(max(inside_row - 1, 0), min(inside_row + 2, TILE)):  # ignores cells of the next tile
        for c in range(max(inside_col - 1, 0), min(inside_col + 2, TILE)):
            free, occupied = tile[r, c, 0], tile[r, c, 1]
            if occupied - 1.0 > near * (free + occupied - 1.0):  # the mass on OCCUPIED, without the division
                away = (row - inside_row + r + 0.5 - row_at) ** 2 + (col - inside_col + c + 0.5 - col_at) ** 2
                if away < _REACH_SQUARED:
                    mass = (occupied - 1.0) / (free + occupied - 1.0)
                    near = max(near, mass * math.exp(exponent * away))
    return near, unknown


@kernel
def log_posterior(
    grid: TileGrid, points: FloatArray, pose: Pose, guess: Pose, deviations: tuple[float, float], model: HitModel
) -> float:
    """Return `log_likelihood` plus a Gaussian log prior around a guess with deviations [m, rad]."""
    position = ((pose[0] - guess[0]) ** 2 + (pose[1] - guess[1]) ** 2) / deviations[0] ** 2
    heading = (pose[2] - guess[2]) ** 2 / deviations[1] ** 2
    return log_likelihood(grid, points, pose, model) - 0.5 * (position + heading)


@kernel
def climb_posterior(
    grid: TileGrid,
    points: FloatArray,
    guess: Pose,
    deviations: tuple[float, float],
    model: HitModel,
    steps: tuple[float, float],
    halvings: int,
) -> tuple[float, float, float, float]:
    """Climb from the guess to a local maximum of `log_posterior`; return x, y, theta and the value there.

    The steps [m, rad] go along the axes. A round without improvement halves them.
    """
    pose = (guess[0], guess[1], guess[2])
    best = log_posterior(grid, points, pose, guess, deviations, model)
    length, angle = steps
    failures = 0
    while failures < halvings:
        improved = False
        for candidate in range(6):
            sign = 1.0 if candidate % 2 == 0 else -1.0
            trial = (
                pose[0] + (sign * length if candidate < 2 else 0.0),
                pose[1] + (sign * length if 2 <= candidate < 4 else 0.0),
                pose[2] + (sign * angle if candidate >= 4 else 0.0),
            )
            value = log_posterior(grid, points, trial, guess, deviations, model)
            if value > best:
                best, pose, improved = value, trial, True
        if not improved:
            failures += 1
            length, angle = 0.5 * length, 0.5 * angle
    return pose[0], pose[1], pose[2], best


@kernel
def sampled_posterior(
    grid: TileGrid,
    points: FloatArray,
    mode: Pose,
    guess: Pose,
    deviations: tuple[float, float],
    model: HitModel,
    steps: tuple[float, float],
) -> tuple[FloatArray, FloatArray, float]:
    """Return mean (3,), covariance (3, 3) and log of the average of the posterior at 27 poses around its mode."""
    offsets, values = np.empty((27, 3)), np.empty(27)
    for i in range(27):
        offsets[i, 0], offsets[i, 1] = (i % 3 - 1) * steps[0], (i // 3 % 3 - 1) * steps[0]
        offsets[i, 2] = (i // 9 - 1) * steps[1]
        trial = (mode[0] + offsets[i, 0], mode[1] + offsets[i, 1], mode[2] + offsets[i, 2])
        values[i] = log_posterior(grid, points, trial, guess, deviations, model)
    highest = values.max()
    weights = np.exp(values - highest)
    total = weights.sum()
    mean, covariance = np.zeros(3), np.zeros((3, 3))
    for i in range(27):
        mean += weights[i] / total * offsets[i]
    for i in range(27):
        apart = offsets[i] - mean
        covariance += weights[i] / total * np.outer(apart, apart)
    mean[0], mean[1], mean[2] = mode[0] + mean[0], mode[1] + mean[1], mode[2] + mean[2]
    return mean, covariance, highest + math.log(total / 27.0)


@kernel
def write_cells(
    grid: TileGrid,
    references: npt.NDArray[np.int64],
    free: Index,
    free_count: int,
    cells: npt.NDArray[np.int32],
    is_hit: npt.NDArray[np.bool_],
    factors: BeamFactors,
) -> int:
    """Combine evidence into lattice cells (M, 2), all within the grid; return the number of free tiles left.

    `references` (N,) are the numbers of grids that use each tile of the pool, and are updated. The last of the first
    `free_count` tiles in `free` are taken first; there must be enough.
    """
    for i in range(len(cells)):
        row, col = cells[i, 0], cells[i, 1]
        tile_row, tile_col = (row >> TILE_BITS) - grid.first_row, (col >> TILE_BITS) - grid.first_col
        tile = grid.places[tile_row, tile_col]
        if tile == 0 or references[tile] > 1:
            free_count -= 1
            own = free[free_count]
            grid.tiles[own] = grid.tiles[tile]
            references[tile] -= 1
            references[own] = 1
            grid.places[tile_row, tile_col] = own
            tile = own
        change = factors.hit if is_hit[i] else factors.miss
        for k in range(2):
            before = grid.tiles[tile, row & (TILE - 1), col & (TILE - 1), k]
            after = before + change[k] if factors.adds else before * change[k]
            grid.tiles[tile, row & (TILE - 1), col & (TILE - 1), k] = after
        _keep_finite(grid.tiles[tile, row & (TILE - 1), col & (TILE - 1)])
    return free_count


@kernel
def _keep_finite(ratios: Tiles) -> None:
    if ratios[0] > _RATIO_LIMIT or ratios[1] > _RATIO_LIMIT:
        ratios[0], ratios[1] = max(ratios[0] * 1e-10, 1.0), max(ratios[1] * 1e-10, 1.0)
