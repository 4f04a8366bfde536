"""Surface elements (surfels), fitted to the hits around each cell.

The two faces of a thin wall must not be confused, so surfaces are stored in two layers by the direction of their
normal. Most cells contain no wall. Cells are therefore grouped into tiles of `SIDE` by `SIDE`, and only tiles near hits
have moments and surfels. Tile 0 is unused and stays empty. Hits update the moments only; a surfel is fitted on demand.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, Pose, kernel, part
from tbmslam.kernels.rays.lattice import Lattice

SurfelArray = npt.NDArray[np.float32]
TileIndex = npt.NDArray[np.int32]
Cells = npt.NDArray[np.int32]
"""Row, column and layer (N, 3) of the cells of hits."""
SIDE = 4
"""Side of a tile [cells]."""
CELLS = SIDE * SIDE
TILE_BITS, IN_TILE = SIDE.bit_length() - 1, SIDE - 1
"""The row of a cell, shifted right by `TILE_BITS`, is the row of its tile; masked by `IN_TILE`, the row in the tile."""
FACING = (0.7986, 0.6018)
"""Surfaces with normals in this half plane belong to layer 1; it is oblique to walls along the axes of the map."""


class Surfels(NamedTuple):
    """The arrays of a surfel map; at least two cells lie beside a cell with hits on every side."""

    tiles: TileIndex
    """Numbers (2, rows / SIDE, cols / SIDE) of the tiles of each layer. A tile's cells have consecutive slots."""
    moments: SurfelArray
    """(slots, 6): number of hits in a cell, sums of x, y, x^2, x y and y^2 from its centre [cells]."""
    fits: SurfelArray
    """(slots, 8): mean x and y [m] of the hits in a cell and around it, information xx, xy, yy of an offset from the
    mean [1/m^2], and a weight. The weight is in [0, 1], zero without a surface, and negative if hits were added after
    the fit. Two unused numbers align the rows with the memory."""
    lattice: Lattice
    limits: tuple[float, float, float, float]
    """Noise of a hit [m], largest size of a point [m], thickness at which a surfel counts half [m], and number of
    hits of a certain surfel."""


SurfelArrays = tuple[TileIndex, SurfelArray, SurfelArray, tuple[float, int, int], tuple[float, float, float, float]]
"""The fields of a `Surfels` as plain tuples, which are passed to a kernel in a quarter of the time."""


@part
def layer_of(normal_x: float, normal_y: float) -> int:
    """Return the layer of a surface from its normal in the map's frame."""
    return 1 if normal_x * FACING[0] + normal_y * FACING[1] > 0.0 else 0


@part
def slot_of(tiles: TileIndex, layer: int, row: int, col: int) -> np.uint32:
    """Return the slot of a cell; slots below `CELLS` belong to the unused tile."""
    # Unsigned indices need no check for negative values.
    tile = tiles[np.uint32(layer), np.uint32(row >> TILE_BITS), np.uint32(col >> TILE_BITS)]
    return np.uint32(tile * CELLS + (row & IN_TILE) * SIDE + (col & IN_TILE))


@kernel
def extent(points: FloatArray) -> tuple[float, float, float, float]:
    """Return the smallest and largest x, then the smallest and largest y, of points (N, 2)."""
    left, right, bottom, top = math.inf, -math.inf, math.inf, -math.inf
    for i in range(len(points)):
        left, right = min(left, points[i, 0]), max(right, points[i, 0])
        bottom, top = min(bottom, points[i, 1]), max(top, points[i, 1])
    return left, right, bottom, top


@part
def cells_of(
    points: FloatArray, normals: FloatArray, pose: Pose, lattice: tuple[float, int, int]
) -> tuple[Cells, FloatArray]:
    """Return the cells (N, 3) of hits (N, 2) [m] of a frame at a pose, and their offsets from the centres (N, 2).

    `normals` (N, 2) are the normals of the surfaces, towards the laser, in the same frame.
    """
    resolution, first_row, first_col = lattice
    cosine, sine, inverse = math.cos(pose[2]), math.sin(pose[2]), 1.0 / resolution
    cells, offsets = np.empty((len(points), 3), dtype=np.int32), np.empty((len(points), 2))
    for i in range(len(points)):
        gx = (pose[0] + cosine * points[i, 0] - sine * points[i, 1]) * inverse
        gy = (pose[1] + sine * points[i, 0] + cosine * points[i, 1]) * inverse
        left, bottom = math.floor(gx), math.floor(gy)
        nx, ny = normals[i, 0], normals[i, 1]
        cells[i, 0], cells[i, 1] = bottom - first_row, left - first_col
        cells[i, 2] = layer_of(cosine * nx - sine * ny, sine * nx + cosine * ny)
        offsets[i, 0], offsets[i, 1] = gx - left - 0.5, gy - bottom - 0.5
    return cells, offsets


@part
def claim_tiles(tiles: TileIndex, used: int, cells: Cells) -> int:
    """Assign numbers from `used` on to the tiles that hits in cells (N, 3) need; return the number of used tiles."""
    last_row, last_col, last_layer = -1, -1, -1
    for i in range(len(cells)):
        row, col, layer = cells[i, 0], cells[i, 1], cells[i, 2]
        if row == last_row and col == last_col and layer == last_layer:
            continue
        last_row, last_col, last_layer = row, col, layer
        # The cells around one lie in four tiles at the most; often some of them are the same.
        below, above = (row - 1) >> TILE_BITS, (row + 1) >> TILE_BITS
        left, right = (col - 1) >> TILE_BITS, (col + 1) >> TILE_BITS
        used = _claim_tile(tiles, layer, below, left, used)
        used = _claim_tile(tiles, layer, below, right, used)
        used = _claim_tile(tiles, layer, above, left, used)
        used = _claim_tile(tiles, layer, above, right, used)
    return used


@part
def _claim_tile(tiles: TileIndex, layer: int, row: int, col: int, used: int) -> int:
    """Give the number `used` to a tile without one, and return how many are in use then."""
    if tiles[np.uint32(layer), np.uint32(row), np.uint32(col)] != 0:
        return used
    tiles[np.uint32(layer), np.uint32(row), np.uint32(col)] = used
    return used + 1


@part
def add_hits(surfels: SurfelArrays, cells: Cells, offsets: FloatArray) -> None:
    """Add hits in the form of `cells_of`; their tiles must be claimed and allocated."""
    tiles, moments, fits, _, _ = surfels
    last_row, last_col, last_layer, slot = -1, -1, -1, np.uint32(0)
    for i in range(len(cells)):
        row, col, layer = cells[i, 0], cells[i, 1], cells[i, 2]
        if row != last_row or col != last_col or layer != last_layer:
            last_row, last_col, last_layer = row, col, layer
            for r in range(row - 1, row + 2):
                for c in range(col - 1, col + 2):
                    fits[slot_of(tiles, layer, r, c), 5] = -1.0
            slot = slot_of(tiles, layer, row, col)
        dx, dy = offsets[i, 0], offsets[i, 1]
        moments[slot, 0] += np.float32(1.0)
        moments[slot, 1] += np.float32(dx)
        moments[slot, 2] += np.float32(dy)
        moments[slot, 3] += np.float32(dx * dx)
        moments[slot, 4] += np.float32(dx * dy)
        moments[slot, 5] += np.float32(dy * dy)


@kernel
def insert_hits(surfels: SurfelArrays, used: int, points: FloatArray, normals: FloatArray, pose: Pose) -> int:
    """Add hits (N, 2) [m] and their normals (N, 2) of a frame at a pose, if the arrays are large enough.

    Returns the number of tiles in use. If the arrays have fewer tiles, no hit was added. Returns -1 if hits lie outside
    the lattice or within two cells of its border. The memory of tiles that were not in use may hold anything.
    """
    tiles, moments, fits, lattice, _ = surfels
    cells, offsets = cells_of(points, normals, pose, lattice)
    last_row, last_col = SIDE * tiles.shape[1] - 3, SIDE * tiles.shape[2] - 3
    for i in range(len(cells)):
        if cells[i, 0] < 2 or cells[i, 1] < 2 or cells[i, 0] > last_row or cells[i, 1] > last_col:
            return -1
    first_new = used * CELLS
    used = claim_tiles(tiles, used, cells)
    for slot in range(first_new, min(used * CELLS, len(moments))):
        for k in range(moments.shape[1]):
            moments[slot, k] = 0.0
        for k in range(fits.shape[1]):
            fits[slot, k] = 0.0
    if used * CELLS <= len(moments):
        add_hits(surfels, cells, offsets)
    return used


@part
def fit_surfel(surfels: SurfelArrays, layer: int, row: int, col: int) -> None:
    """Fit one surfel to the hits of its cell and of the eight cells around it."""
    tiles, moments, fits, lattice, limits = surfels
    resolution, first_row, first_col = lattice
    noise, point_size, clutter, certain_count = limits
    count, sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(-1, 2):
        left, here = slot_of(tiles, layer, row + r, col - 1), slot_of(tiles, layer, row + r, col)
        right, y = slot_of(tiles, layer, row + r, col + 1), np.float32(r)
        # The moments of three cells about the middle one; single precision has an error of 0.05 mm.
        beside, shift = moments[left, 0] + moments[right, 0], moments[right, 0] - moments[left, 0]
        twist, lean = moments[right, 1] - moments[left, 1], moments[right, 2] - moments[left, 2]
        n = beside + moments[here, 0]
        mx = moments[left, 1] + moments[here, 1] + moments[right, 1] + shift
        my = moments[left, 2] + moments[here, 2] + moments[right, 2]
        # Then about the surfel, whose row is `y` cells away.
        count += n
        sx += mx
        sy += my + n * y
        sxx += moments[left, 3] + moments[here, 3] + moments[right, 3] + twist + twist + beside
        sxy += moments[left, 4] + moments[here, 4] + moments[right, 4] + lean + y * mx
        syy += moments[left, 5] + moments[here, 5] + moments[right, 5] + y * (my + my + n * y)
    fit = fits[slot_of(tiles, layer, row, col)]
    if count < 3.0:
        fit[5] = 0.0
        return
    # Few divisions, which take most of the time.
    each, scale = 1.0 / count, resolution * resolution
    mx, my = sx * each, sy * each
    xx, xy, yy = (sxx * each - mx * mx) * scale, (sxy * each - mx * my) * scale, (syy * each - my * my) * scale
    middle, half, spread = 0.5 * (xx + yy), 0.5 * (xx - yy), math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    thick, thin = max(middle + spread, 0.0), max(middle - spread, 0.0)
    across = 1.0 / (thin + noise * noise)
    along = 1.0 / (thick + noise * noise) if thick < point_size * point_size else 0.0
    # The larger variance is along the wall: t t^T = (1 + D) / 2 with D = (C - middle) / spread, n n^T = (1 - D) / 2.
    mean, difference = 0.5 * (across + along), 0.5 * (across - along)
    per_spread = difference / spread if spread > 0.0 else 0.0
    fit[0] = (first_col + col + 0.5 + mx) * resolution
    fit[1] = (first_row + row + 0.5 + my) * resolution
    fit[2] = mean - per_spread * half
    fit[3] = -per_spread * xy
    fit[4] = mean + per_spread * half
    fit[5] = min(count, certain_count) * clutter * clutter / (certain_count * (clutter * clutter + thin))
