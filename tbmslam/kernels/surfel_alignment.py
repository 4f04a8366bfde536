"""A scan moved onto surface elements: Gauss and Newton's steps, the uncertain direction left to the prior."""

import math

import numpy as np

from tbmslam.kernels import FloatArray, Pose, kernel
from tbmslam.kernels.surfels import CELLS, FACING, IN_TILE, SIDE, TILE_BITS, Surfels, fit_surfel

BITS, MASK = np.uint32(TILE_BITS), np.uint32(IN_TILE)

LEADING_POINTS = 120
"""Points that lead through the wide tolerances, at least."""

STALE = 0.3
"""Part of a cell that points move by before their surfels are looked up anew."""

TYPICAL_RANGE = 5.0
"""Distance of points by which a turn moves them, as far as that matters [m]."""


@kernel
def pair_up(
    surfels: Surfels, points: FloatArray, normals: FloatArray, every: int, pose: Pose, pairs: FloatArray
) -> int:
    """Write every n-th point that has a surfel, and the surfel, to a row of `pairs`; return how many there are.

    Parameters
    ----------
    points, normals
        Points (N, 2) [m] and the normals (N, 2) of what was hit, in the scan's frame.
    every
        Which n that is.
    pose
        Where the scan lies.
    pairs
        (N, 8): a point in the scan's frame, its surfel's mean, information xx, xy, yy, and weight.
    """
    tiles, _, fits, lattice, _ = surfels
    resolution, first_row, first_col = lattice
    _, tile_rows, tile_cols = tiles.shape
    rows, cols = float(tile_rows * SIDE), float(tile_cols * SIDE)
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    # What tells the layers apart, in the scan's frame; see `layer_of`.
    facing_x, facing_y = cosine * FACING[0] + sine * FACING[1], cosine * FACING[1] - sine * FACING[0]
    inverse, count = 1.0 / resolution, 0
    for i in range(0, len(points), every):
        px, py = points[i, 0], points[i, 1]
        cell_x = (x + cosine * px - sine * py) * inverse - first_col
        cell_y = (y + sine * px + cosine * py) * inverse - first_row
        if not (0.0 <= cell_x < cols and 0.0 <= cell_y < rows):
            continue
        col, row = np.uint32(cell_x), np.uint32(cell_y)
        layer = 1 if normals[i, 0] * facing_x + normals[i, 1] * facing_y > 0.0 else 0
        tile = np.uint32(tiles[layer, row >> BITS, col >> BITS])
        slot = tile * np.uint32(CELLS) + (row & MASK) * np.uint32(SIDE) + (col & MASK)
        if fits[slot, 5] < 0.0:
            fit_surfel(surfels, layer, int(row), int(col))
        pairs[count, 0], pairs[count, 1] = px, py
        for k in range(6):
            pairs[count, 2 + k] = fits[slot, k]
        # A branch would be guessed wrongly too often: what has no surfel is written over.
        count += int(fits[slot, 5] > 0.0)
    return count


@kernel
def linearise(
    pairs: FloatArray, share: float, pose: Pose, tolerance: float, hessian: FloatArray, gradient: FloatArray
) -> tuple[float, float]:
    """Fill the normal equations of a scan's mean distance to its surfels; return that cost and the matched share.

    `pairs` are as `pair_up` writes them, and each counts as a `share` of the scan. The cost of a point is Geman and
    McClure's t^2 d^2 / (t^2 + d^2) of its Mahalanobis distance d, with the tolerance t in standard deviations: far
    points lose their say. The pose is perturbed in the map's frame, its rotation about the sensor.
    """
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    cost, matched = 0.0, 0.0
    xx, xy, yy, xt, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sum_x, sum_y, sum_t = 0.0, 0.0, 0.0
    tolerance_squared = tolerance * tolerance
    for i in range(len(pairs)):
        px, py = pairs[i, 0], pairs[i, 1]
        rx, ry = cosine * px - sine * py, sine * px + cosine * py
        dx, dy = x + rx - pairs[i, 2], y + ry - pairs[i, 3]
        ixx, ixy, iyy = pairs[i, 4], pairs[i, 5], pairs[i, 6]
        gx, gy = ixx * dx + ixy * dy, ixy * dx + iyy * dy
        distance = dx * gx + dy * gy
        say = tolerance_squared / (tolerance_squared + distance)
        weight = pairs[i, 7] * say
        matched += weight
        cost += weight * distance
        weight *= say
        # d(point)/d(theta) = (-ry, rx)
        jx = ixy * rx - ixx * ry
        jy = iyy * rx - ixy * ry
        xx += weight * ixx
        xy += weight * ixy
        yy += weight * iyy
        xt += weight * jx
        yt += weight * jy
        tt += weight * (rx * jy - ry * jx)
        sum_x += weight * gx
        sum_y += weight * gy
        sum_t += weight * (rx * gy - ry * gx)
    hessian[0, 0], hessian[1, 1], hessian[2, 2] = xx * share, yy * share, tt * share
    hessian[0, 1] = hessian[1, 0] = xy * share
    hessian[0, 2] = hessian[2, 0] = xt * share
    hessian[1, 2] = hessian[2, 1] = yt * share
    gradient[0], gradient[1], gradient[2] = sum_x * share, sum_y * share, sum_t * share
    return cost * share, matched * share


@kernel
def align(
    surfels: Surfels,
    points: FloatArray,
    normals: FloatArray,
    every: int,
    guess: Pose,
    deviations: FloatArray,
    say: float,
    tolerances: FloatArray,
    iterations: int,
) -> tuple[Pose, FloatArray, float, float]:
    """Move a scan onto the surfels by Gauss-Newton; return its pose, the Hessian, the matched share and the cost.

    Every `every`-th point is used, and fewer as long as the tolerance is wide. `deviations` (3,) are the guess's in the
    map's frame: a direction that the surfels do not determine keeps it. All points together count as `say` independent
    ones. `tolerances` are worked through from wide to narrow, `iterations` steps each at the most.
    """
    x, y, theta = guess
    prior = (deviations[0] ** -2.0, deviations[1] ** -2.0, deviations[2] ** -2.0)
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    system, step = np.zeros((3, 3)), np.zeros(3)
    pairs = np.empty((len(points), 8))
    cost, matched = 0.0, 0.0
    near = STALE * surfels.lattice.resolution
    for level in range(len(tolerances)):
        # A wide tolerance only leads to where the next one starts.
        is_last = level == len(tolerances) - 1
        enough = 1.0 if is_last else 10.0
        stride = every if is_last else max(every, len(points) // LEADING_POINTS)
        share = 1.0 / max(-(-len(points) // stride), 1)
        count, moved = 0, math.inf
        for _ in range(iterations):
            if moved > near:
                count, moved = pair_up(surfels, points, normals, stride, (x, y, theta), pairs), 0.0
            cost, matched = linearise(pairs[:count], share, (x, y, theta), tolerances[level], hessian, gradient)
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
            shift, turn = max(abs(step[0]), abs(step[1])), abs(step[2])
            moved += shift + TYPICAL_RANGE * turn
            if shift < enough * 2e-4 and turn < enough * 2e-5:
                break
    return (x, y, theta), hessian, matched, cost * say


@kernel
def _drop_weak_direction(hessian: FloatArray, gradient: FloatArray) -> None:
    """Silence a direction of the plane that hardly any surface faces, such as the one along a corridor.

    Fitted normals scatter by a degree or two, and what that leaks along a wall is no evidence: a curvature below 1/8 %
    of the one across is dropped, above 3/8 % it is kept, with a ramp between. More would silence door frames too.
    """
    middle = 0.5 * (hessian[0, 0] + hessian[1, 1])
    spread = math.hypot(0.5 * (hessian[0, 0] - hessian[1, 1]), hessian[0, 1])
    if middle + spread <= 0.0:
        return
    kept = min(max((middle - spread) / (middle + spread) * 400.0 - 0.5, 0.0), 1.0)
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
