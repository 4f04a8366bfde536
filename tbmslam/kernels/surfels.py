"""Surface elements: what the hits around a cell say about the wall there, and the alignment of a scan with them.

The two faces of a thin wall must not be taken for each other, so surfaces are kept in two layers by the way they face.
Most cells of a map hold no wall, so cells come in tiles of `SIDE` by `SIDE` and only tiles with hits, or next to some,
have moments and surfels; tile 0 is nobody's and stays empty. Hits only add to the moments; a surfel is fitted when it
is asked for.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel
from tbmslam.kernels.lattice import Lattice

FloatArray = npt.NDArray[np.float64]
SurfelArray = npt.NDArray[np.float32]
TileIndex = npt.NDArray[np.int32]
SIDE = 4
"""Cells along a side of a tile."""
CELLS = SIDE * SIDE
FACING = (0.7986, 0.6018)
"""Surfaces whose normal points along this belong to layer 1; oblique to the walls of a building that lies square."""

Pose = tuple[float, float, float]
"""x [m], y [m], theta [rad]; an SE2 is one."""


class Surfels(NamedTuple):
    """The arrays of a surfel map; a cell with hits has two more cells on every side."""

    tiles: TileIndex
    """(2, rows / SIDE, cols / SIDE): the number of each layer's tile. Its cells' slots follow one another."""
    moments: SurfelArray
    """(slots, 6): count of a cell's hits, sums of x and y, and of x^2, x y and y^2, from its centre [cells]."""
    fits: SurfelArray
    """(slots, 6): mean x and y [m] of the hits in a cell and around it, information xx, xy, yy of an offset from it
    [1/m^2], and a weight: in [0, 1], zero where there is no surface, negative where hits came after the fit."""
    lattice: Lattice
    limits: tuple[float, float, float, float]
    """Noise of a hit [m], size up to which an element counts as a point [m], thickness beyond which it is clutter [m],
    and number of hits that make an element certain."""


@kernel
def layer_of(normal_x: float, normal_y: float) -> int:
    """Return the layer of a surface by its normal in the map's frame."""
    return 1 if normal_x * FACING[0] + normal_y * FACING[1] > 0.0 else 0


@kernel
def slot_of(tiles: TileIndex, layer: int, row: int, col: int) -> int:
    """Return a cell's slot; one below `CELLS` is nobody's."""
    return int(tiles[layer, row // SIDE, col // SIDE] * CELLS + row % SIDE * SIDE + col % SIDE)


@kernel
def extent(points: FloatArray) -> tuple[float, float, float, float]:
    """Return the smallest and largest x, then the smallest and largest y, of points (N, 2)."""
    left, right, bottom, top = math.inf, -math.inf, math.inf, -math.inf
    for i in range(len(points)):
        left, right = min(left, points[i, 0]), max(right, points[i, 0])
        bottom, top = min(bottom, points[i, 1]), max(top, points[i, 1])
    return left, right, bottom, top


@kernel
def claim_tiles(tiles: TileIndex, lattice: Lattice, used: int, points: FloatArray, normals: FloatArray) -> int:
    """Give numbers from `used` on to the tiles that hits (N, 2) [m] need, and return how many are in use then.

    `normals` (N, 2) are those of the surfaces hit, towards the laser, in the map's frame.
    """
    resolution, first_row, first_col = lattice
    for i in range(len(points)):
        row = math.floor(points[i, 1] / resolution) - first_row
        col = math.floor(points[i, 0] / resolution) - first_col
        layer = layer_of(normals[i, 0], normals[i, 1])
        for r in range((row - 1) // SIDE, (row + 1) // SIDE + 1):
            for c in range((col - 1) // SIDE, (col + 1) // SIDE + 1):
                if tiles[layer, r, c] == 0:
                    tiles[layer, r, c] = used
                    used += 1
    return used


@kernel
def add_hits(surfels: Surfels, points: FloatArray, normals: FloatArray) -> None:
    """Add hits (N, 2) [m] and their normals (N, 2), whose tiles have been claimed and have room."""
    tiles, moments, fits, lattice, _ = surfels
    resolution, first_row, first_col = lattice
    last_row, last_col, last_layer = -1, -1, -1
    for i in range(len(points)):
        gx, gy = points[i, 0] / resolution, points[i, 1] / resolution
        lattice_col, lattice_row = math.floor(gx), math.floor(gy)
        row, col = lattice_row - first_row, lattice_col - first_col
        layer = layer_of(normals[i, 0], normals[i, 1])
        if row != last_row or col != last_col or layer != last_layer:
            last_row, last_col, last_layer = row, col, layer
            for r in range(row - 1, row + 2):
                for c in range(col - 1, col + 2):
                    fits[slot_of(tiles, layer, r, c), 5] = -1.0
        dx, dy = gx - lattice_col - 0.5, gy - lattice_row - 0.5
        slot = slot_of(tiles, layer, row, col)
        moments[slot, 0] += np.float32(1.0)
        moments[slot, 1] += np.float32(dx)
        moments[slot, 2] += np.float32(dy)
        moments[slot, 3] += np.float32(dx * dx)
        moments[slot, 4] += np.float32(dx * dy)
        moments[slot, 5] += np.float32(dy * dy)


@kernel
def fit_surfel(surfels: Surfels, layer: int, row: int, col: int) -> None:
    """Fit one surfel to the hits of its cell and the eight around it."""
    tiles, moments, fits, lattice, limits = surfels
    resolution, first_row, first_col = lattice
    noise, point_size, clutter, certain_count = limits
    count, sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(row - 1, row + 2):
        for c in range(col - 1, col + 2):
            slot = slot_of(tiles, layer, r, c)
            n = float(moments[slot, 0])
            if n == 0.0:
                continue
            ox, oy = float(c - col), float(r - row)
            mx, my = float(moments[slot, 1]), float(moments[slot, 2])
            count += n
            sx += mx + n * ox
            sy += my + n * oy
            sxx += moments[slot, 3] + 2.0 * ox * mx + n * ox * ox
            sxy += moments[slot, 4] + ox * my + oy * mx + n * ox * oy
            syy += moments[slot, 5] + 2.0 * oy * my + n * oy * oy
    fit = fits[slot_of(tiles, layer, row, col)]
    if count < 3.0:
        fit[5] = 0.0
        return
    mx, my = sx / count, sy / count
    scale = resolution * resolution
    xx, xy, yy = (
        (sxx / count - mx * mx) * scale,
        (sxy / count - mx * my) * scale,
        (syy / count - my * my) * scale,
    )
    middle, half, spread = 0.5 * (xx + yy), 0.5 * (xx - yy), math.hypot(0.5 * (xx - yy), xy)
    thick, thin = max(middle + spread, 0.0), max(middle - spread, 0.0)
    across = 1.0 / (thin + noise * noise)
    along = 1.0 / (thick + noise * noise) if thick < point_size * point_size else 0.0
    # The larger variance runs along the wall: t t^T = (1 + D) / 2 with D = (C - middle) / spread, n n^T = (1 - D) / 2.
    cosine, sine = (half / spread, xy / spread) if spread > 0.0 else (1.0, 0.0)
    mean, difference = 0.5 * (across + along), 0.5 * (across - along)
    fit[0] = (first_col + col + 0.5 + mx) * resolution
    fit[1] = (first_row + row + 0.5 + my) * resolution
    fit[2] = mean - difference * cosine
    fit[3] = -difference * sine
    fit[4] = mean + difference * cosine
    fit[5] = min(count / certain_count, 1.0) / (1.0 + thin / (clutter * clutter))


@kernel
def linearise(
    surfels: Surfels,
    points: FloatArray,
    normals: FloatArray,
    pose: Pose,
    tolerance: float,
    hessian: FloatArray,
    gradient: FloatArray,
) -> tuple[float, float]:
    """Fill the normal equations of a scan's mean distance to the surfels; return that cost and the matched share.

    The cost of a point is Geman and McClure's t^2 d^2 / (t^2 + d^2) of its Mahalanobis distance d, with the tolerance t
    in standard deviations: far points lose their say. The pose is perturbed in the map's frame, its rotation about the
    sensor.
    """
    tiles, _, fits, lattice, _ = surfels
    resolution, first_row, first_col = lattice
    rows, cols = tiles.shape[1] * SIDE, tiles.shape[2] * SIDE
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    cost, matched = 0.0, 0.0
    xx, xy, yy, xt, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sum_x, sum_y, sum_t = 0.0, 0.0, 0.0
    tolerance_squared = tolerance * tolerance
    inverse = 1.0 / resolution
    for i in range(len(points)):
        rx, ry = cosine * points[i, 0] - sine * points[i, 1], sine * points[i, 0] + cosine * points[i, 1]
        px, py = x + rx, y + ry
        col = math.floor(px * inverse) - first_col
        row = math.floor(py * inverse) - first_row
        if row < 0 or col < 0 or row >= rows or col >= cols:
            continue
        layer = layer_of(cosine * normals[i, 0] - sine * normals[i, 1], sine * normals[i, 0] + cosine * normals[i, 1])
        slot = slot_of(tiles, layer, row, col)
        if fits[slot, 5] < 0.0:
            fit_surfel(surfels, layer, row, col)
        weight = float(fits[slot, 5])
        if weight == 0.0:
            continue
        dx, dy = px - fits[slot, 0], py - fits[slot, 1]
        ixx, ixy, iyy = fits[slot, 2], fits[slot, 3], fits[slot, 4]
        gx, gy = ixx * dx + ixy * dy, ixy * dx + iyy * dy
        distance = dx * gx + dy * gy
        share = tolerance_squared / (tolerance_squared + distance)
        matched += weight * share
        cost += weight * share * distance
        weight *= share * share
        # d(point)/d(theta) = (-ry, rx)
        jx = -ixx * ry + ixy * rx
        jy = -ixy * ry + iyy * rx
        xx += weight * ixx
        xy += weight * ixy
        yy += weight * iyy
        xt += weight * jx
        yt += weight * jy
        tt += weight * (-ry * jx + rx * jy)
        sum_x += weight * gx
        sum_y += weight * gy
        sum_t += weight * (-ry * gx + rx * gy)
    each = 1.0 / max(len(points), 1)
    hessian[0, 0], hessian[1, 1], hessian[2, 2] = xx * each, yy * each, tt * each
    hessian[0, 1] = hessian[1, 0] = xy * each
    hessian[0, 2] = hessian[2, 0] = xt * each
    hessian[1, 2] = hessian[2, 1] = yt * each
    gradient[0], gradient[1], gradient[2] = sum_x * each, sum_y * each, sum_t * each
    return cost * each, matched * each


@kernel
def align(
    surfels: Surfels,
    points: FloatArray,
    normals: FloatArray,
    guess: Pose,
    deviations: FloatArray,
    say: float,
    tolerances: FloatArray,
    iterations: int,
) -> tuple[Pose, FloatArray, float, float]:
    """Move a scan onto the surfels by Gauss-Newton; return its pose, the Hessian, the matched share and the cost.

    `deviations` (3,) are the guess's in the map's frame: a direction that the surfels do not determine keeps it. All
    points together count as `say` independent ones. `tolerances` are worked through from wide to narrow, `iterations`
    steps each at the most.
    """
    x, y, theta = guess
    prior = (deviations[0] ** -2.0, deviations[1] ** -2.0, deviations[2] ** -2.0)
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    system, step = np.zeros((3, 3)), np.zeros(3)
    cost, matched = 0.0, 0.0
    for level in range(len(tolerances)):
        # A wide tolerance only leads to where the next one starts.
        enough = 1.0 if level == len(tolerances) - 1 else 10.0
        for _ in range(iterations):
            cost, matched = linearise(surfels, points, normals, (x, y, theta), tolerances[level], hessian, gradient)
            hessian *= say
            gradient *= say
            _drop_weak_direction(hessian, gradient)
            system[:] = hessian
            gradient[0] += prior[0] * (x - guess[0])
            gradient[1] += prior[1] * (y - guess[1])
            gradient[2] += prior[2] * (theta - guess[2])
            for a in range(3):
                system[a, a] += prior[a]
            _solve(system, gradient, step)
            x, y, theta = x - step[0], y - step[1], theta - step[2]
            if max(abs(step[0]), abs(step[1])) < enough * 2e-4 and abs(step[2]) < enough * 2e-5:
                break
    return (x, y, theta), hessian, matched, cost * say


@kernel
def _drop_weak_direction(hessian: FloatArray, gradient: FloatArray) -> None:
    """Silence a direction of the plane that hardly any surface faces, such as the one along a corridor.

    Fitted normals scatter by some degrees, and what that leaks along a wall is no evidence: a curvature below 0.5 % of
    the one across is dropped, above 1.5 % it is kept, with a ramp between.
    """
    middle = 0.5 * (hessian[0, 0] + hessian[1, 1])
    spread = math.hypot(0.5 * (hessian[0, 0] - hessian[1, 1]), hessian[0, 1])
    if middle + spread <= 0.0:
        return
    kept = min(max((middle - spread) / (middle + spread) * 100.0 - 0.5, 0.0), 1.0)
    if kept >= 1.0:
        return
    angle = 0.5 * math.atan2(2.0 * hessian[0, 1], hessian[0, 0] - hessian[1, 1])
    weak = np.array([-math.sin(angle), math.cos(angle), 0.0])
    # P = I - (1 - kept) weak weak^T leaves the rest as it is; the system becomes P H P, P g.
    for a in range(3):
        along = hessian[a, 0] * weak[0] + hessian[a, 1] * weak[1]
        for b in range(2):
            hessian[a, b] -= (1.0 - kept) * along * weak[b]
    for b in range(3):
        along = weak[0] * hessian[0, b] + weak[1] * hessian[1, b]
        for a in range(2):
            hessian[a, b] -= (1.0 - kept) * along * weak[a]
    along = weak[0] * gradient[0] + weak[1] * gradient[1]
    gradient[0] -= (1.0 - kept) * along * weak[0]
    gradient[1] -= (1.0 - kept) * along * weak[1]


@kernel
def _solve(matrix: FloatArray, vector: FloatArray, solution: FloatArray) -> None:
    """Solve a symmetric positive definite (3, 3) system by Cholesky's method."""
    a = math.sqrt(max(matrix[0, 0], 1e-12))
    b, c = matrix[0, 1] / a, matrix[0, 2] / a
    d = math.sqrt(max(matrix[1, 1] - b * b, 1e-12))
    e = (matrix[1, 2] - b * c) / d
    f = math.sqrt(max(matrix[2, 2] - c * c - e * e, 1e-12))
    u = vector[0] / a
    v = (vector[1] - b * u) / d
    w = (vector[2] - c * u - e * v) / f
    solution[2] = w / f
    solution[1] = (v - e * solution[2]) / d
    solution[0] = (u - b * solution[1] - c * solution[2]) / a
