"""Surface elements: what the hits around a cell say about the wall there, and the alignment of a scan with them.

The two faces of a thin wall must not be taken for each other, so surfaces are kept in two layers by the way they face.
Most cells of a map hold no wall, so an index (2, rows, cols) names the slot of each cell's moments and surfel; slot 0
is nobody's and stays empty. Moments (slots, 6) of a cell are its hits' count, sums of x and y, and sums of x^2, x y and
y^2, relative to the cell's centre in units of cells. Surfels (slots, 6) are mean x and y [m], and the information
matrix xx, xy, yy of a point's offset from the mean [1/m^2], then a weight in [0, 1], zero where there is no surface.
"""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel
from tbmslam.kernels.lattice import Lattice

FloatArray = npt.NDArray[np.float64]
SurfelArray = npt.NDArray[np.float32]
SlotIndex = npt.NDArray[np.int32]
FACING = (0.7986, 0.6018)
"""Surfaces whose normal points along this belong to layer 1; oblique to the walls of a building that lies square."""

Pose = tuple[float, float, float]
"""x [m], y [m], theta [rad]; an SE2 is one."""


@kernel
def _layer(normal_x: float, normal_y: float) -> int:
    """Return the layer of a surface by its normal in the map's frame."""
    return 1 if normal_x * FACING[0] + normal_y * FACING[1] > 0.0 else 0


@kernel
def add_hits(
    index: SlotIndex,
    moments: SurfelArray,
    surfels: SurfelArray,
    used: int,
    lattice: Lattice,
    points: FloatArray,
    normals: FloatArray,
    limits: tuple[float, float, float, float],
    renew: bool,
) -> int:
    """Add hits (N, 2) [m], all inside with a cell to spare, renew the surfels around them, return the slots in use.

    `normals` (N, 2) are those of the surfaces hit, towards the laser, in the map's frame.

    There must be room for nine more slots a hit. `limits` are the noise of a hit [m], the size up to which an element
    counts as a point [m], the thickness beyond which it is clutter [m], and the number of hits that make an element
    certain. Without `renew` the surfels are left for `renew_all`.
    """
    resolution, first_row, first_col = lattice
    cells = np.empty((len(points), 3), dtype=np.int64)
    for i in range(len(points)):
        gx, gy = points[i, 0] / resolution, points[i, 1] / resolution
        lattice_col, lattice_row = math.floor(gx), math.floor(gy)
        row, col = lattice_row - first_row, lattice_col - first_col
        layer = _layer(normals[i, 0], normals[i, 1])
        cells[i, 0], cells[i, 1], cells[i, 2] = row, col, layer
        for r in range(row - 1, row + 2):
            for c in range(col - 1, col + 2):
                if index[layer, r, c] == 0:
                    index[layer, r, c] = used
                    used += 1
        dx, dy = gx - lattice_col - 0.5, gy - lattice_row - 0.5
        cell = moments[index[layer, row, col]]
        cell[0] += 1.0
        cell[1] += dx
        cell[2] += dy
        cell[3] += dx * dx
        cell[4] += dx * dy
        cell[5] += dy * dy
    if not renew:
        return used
    for i in range(len(points)):
        row, col, layer = cells[i, 0], cells[i, 1], cells[i, 2]
        if i > 0 and row == cells[i - 1, 0] and col == cells[i - 1, 1] and layer == cells[i - 1, 2]:
            continue
        for r in range(max(row - 1, 1), min(row + 2, index.shape[1] - 1)):
            for c in range(max(col - 1, 1), min(col + 2, index.shape[2] - 1)):
                _renew(index[layer], moments, surfels, r, c, lattice, limits)
    return used


@kernel
def renew_all(
    index: SlotIndex,
    moments: SurfelArray,
    surfels: SurfelArray,
    lattice: Lattice,
    limits: tuple[float, float, float, float],
) -> None:
    """Fit every surfel anew."""
    for layer in range(2):
        for row in range(1, index.shape[1] - 1):
            for col in range(1, index.shape[2] - 1):
                if index[layer, row, col] != 0:
                    _renew(index[layer], moments, surfels, row, col, lattice, limits)


@kernel
def _renew(
    index: SlotIndex,
    moments: SurfelArray,
    surfels: SurfelArray,
    row: int,
    col: int,
    lattice: Lattice,
    limits: tuple[float, float, float, float],
) -> None:
    """Fit one surfel to the hits of its cell and the eight around it, in one layer's index (rows, cols)."""
    resolution, first_row, first_col = lattice
    noise, point_size, clutter, certain_count = limits
    count, sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(row - 1, row + 2):
        for c in range(col - 1, col + 2):
            cell = moments[index[r, c]]
            n = float(cell[0])
            if n == 0.0:
                continue
            ox, oy = float(c - col), float(r - row)
            mx, my = float(cell[1]), float(cell[2])
            count += n
            sx += mx + n * ox
            sy += my + n * oy
            sxx += cell[3] + 2.0 * ox * mx + n * ox * ox
            sxy += cell[4] + ox * my + oy * mx + n * ox * oy
            syy += cell[5] + 2.0 * oy * my + n * oy * oy
    surfel = surfels[index[row, col]]
    if count < 3.0:
        surfel[5] = 0.0
        return
    mx, my = sx / count, sy / count
    scale = resolution * resolution
    xx, xy, yy = (
        (sxx / count - mx * mx) * scale,
        (sxy / count - mx * my) * scale,
        (syy / count - my * my) * scale,
    )
    middle, spread = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    thick, thin = max(middle + spread, 0.0), max(middle - spread, 0.0)
    # The direction of the larger variance runs along the wall; the normal is across.
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    tx, ty = math.cos(angle), math.sin(angle)
    across = 1.0 / (thin + noise * noise)
    along = 1.0 / (thick + noise * noise) if thick < point_size * point_size else 0.0
    surfel[0] = (first_col + col + 0.5 + mx) * resolution
    surfel[1] = (first_row + row + 0.5 + my) * resolution
    surfel[2] = across * ty * ty + along * tx * tx
    surfel[3] = -across * tx * ty + along * tx * ty
    surfel[4] = across * tx * tx + along * ty * ty
    surfel[5] = min(count / certain_count, 1.0) / (1.0 + thin / (clutter * clutter))


@kernel
def linearise(
    index: SlotIndex,
    surfels: SurfelArray,
    lattice: Lattice,
    points: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    pose: Pose,
    tolerance: float,
    hessian: FloatArray,
    gradient: FloatArray,
) -> tuple[float, float, float]:
    """Fill the normal equations of a scan's distance to the surfels; return cost, matched weight and total weight.

    The cost of a point is Geman and McClure's t^2 d^2 / (t^2 + d^2) of its Mahalanobis distance d, with the tolerance t
    in standard deviations: far points lose their say. The pose is perturbed in the map's frame, its rotation about the
    sensor.
    """
    resolution, first_row, first_col = lattice
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    hessian[:] = 0.0
    gradient[:] = 0.0
    cost, matched, total = 0.0, 0.0, 0.0
    tolerance_squared = tolerance * tolerance
    inverse = 1.0 / resolution
    for i in range(len(points)):
        rx = cosine * points[i, 0] - sine * points[i, 1]
        ry = sine * points[i, 0] + cosine * points[i, 1]
        px, py = x + rx, y + ry
        col = math.floor(px * inverse) - first_col
        row = math.floor(py * inverse) - first_row
        total += weights[i]
        if row < 0 or col < 0 or row >= index.shape[1] or col >= index.shape[2]:
            continue
        layer = _layer(cosine * normals[i, 0] - sine * normals[i, 1], sine * normals[i, 0] + cosine * normals[i, 1])
        surfel = surfels[index[layer, row, col]]
        if surfel[5] <= 0.0:
            continue
        dx, dy = px - surfel[0], py - surfel[1]
        gx, gy = surfel[2] * dx + surfel[3] * dy, surfel[3] * dx + surfel[4] * dy
        distance = dx * gx + dy * gy
        share = tolerance_squared / (tolerance_squared + distance)
        weight = weights[i] * surfel[5]
        cost += weight * share * distance
        matched += weight * share
        weight *= share * share
        # d(point)/d(theta) = (-ry, rx)
        jx = -surfel[2] * ry + surfel[3] * rx
        jy = -surfel[3] * ry + surfel[4] * rx
        hessian[0, 0] += weight * surfel[2]
        hessian[0, 1] += weight * surfel[3]
        hessian[1, 1] += weight * surfel[4]
        hessian[0, 2] += weight * jx
        hessian[1, 2] += weight * jy
        hessian[2, 2] += weight * (-ry * jx + rx * jy)
        gradient[0] += weight * gx
        gradient[1] += weight * gy
        gradient[2] += weight * (-ry * gx + rx * gy)
    hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]
    return cost, matched, total


@kernel
def align(
    index: SlotIndex,
    surfels: SurfelArray,
    lattice: Lattice,
    points: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    guess: Pose,
    prior: FloatArray,
    tolerances: FloatArray,
    iterations: int,
) -> tuple[Pose, FloatArray, float, float]:
    """Move a scan onto the surfels by Gauss-Newton; return its pose, the Hessian, the matched share and the cost.

    `prior` (3, 3) is the information of the guess in the map's frame: a direction that the surfels do not determine
    keeps it. `tolerances` are worked through from wide to narrow, `iterations` steps each at the most.
    """
    x, y, theta = guess
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    system, step = np.zeros((3, 3)), np.zeros(3)
    cost, matched, total = 0.0, 0.0, 0.0
    for level in range(len(tolerances)):
        for _ in range(iterations):
            cost, matched, total = linearise(
                index,
                surfels,
                lattice,
                points,
                normals,
                weights,
                (x, y, theta),
                tolerances[level],
                hessian,
                gradient,
            )
            _drop_weak_direction(hessian, gradient)
            ox, oy, ot = x - guess[0], y - guess[1], theta - guess[2]
            for a in range(3):
                gradient[a] += prior[a, 0] * ox + prior[a, 1] * oy + prior[a, 2] * ot
                for b in range(3):
                    system[a, b] = hessian[a, b] + prior[a, b]
            _solve(system, gradient, step)
            x, y, theta = x - step[0], y - step[1], theta - step[2]
            if abs(step[0]) < 1e-4 and abs(step[1]) < 1e-4 and abs(step[2]) < 1e-5:
                break
    return (x, y, theta), hessian, (matched / total if total > 0.0 else 0.0), cost


@kernel
def search(
    index: SlotIndex,
    surfels: SurfelArray,
    lattice: Lattice,
    points: FloatArray,
    normals: FloatArray,
    guess: Pose,
    shifts: FloatArray,
    turns: FloatArray,
    tolerance: float,
    costs: tuple[float, float],
) -> Pose:
    """Try every turn (K,) [rad] about the guess and every shift (M, 2) [m]; return the pose that matches best.

    A point counts t^2 / (t^2 + d^2) of its Mahalanobis distance d; `costs` are the share of all points that a metre and
    a radian away from the guess must win, so that the nearest of equals is taken.
    """
    resolution, first_row, first_col = lattice
    tolerance_squared = tolerance * tolerance
    best_score = -math.inf
    best = (guess[0], guess[1], guess[2])
    rotated = np.empty_like(points)
    layers = np.empty(len(points), dtype=np.int64)
    for k in range(len(turns)):
        theta = guess[2] + turns[k]
        cosine, sine = math.cos(theta), math.sin(theta)
        for i in range(len(points)):
            rotated[i, 0] = cosine * points[i, 0] - sine * points[i, 1]
            rotated[i, 1] = sine * points[i, 0] + cosine * points[i, 1]
            layers[i] = _layer(
                cosine * normals[i, 0] - sine * normals[i, 1], sine * normals[i, 0] + cosine * normals[i, 1]
            )
        for m in range(len(shifts)):
            x, y = guess[0] + shifts[m, 0], guess[1] + shifts[m, 1]
            away = costs[0] * math.hypot(shifts[m, 0], shifts[m, 1]) + costs[1] * abs(turns[k])
            score = -away * len(points)
            for i in range(len(points)):
                px, py = x + rotated[i, 0], y + rotated[i, 1]
                col = math.floor(px / resolution) - first_col
                row = math.floor(py / resolution) - first_row
                if row < 0 or col < 0 or row >= index.shape[1] or col >= index.shape[2]:
                    continue
                surfel = surfels[index[layers[i], row, col]]
                if surfel[5] > 0.0:
                    dx, dy = px - surfel[0], py - surfel[1]
                    distance = dx * (surfel[2] * dx + 2.0 * surfel[3] * dy) + surfel[4] * dy * dy
                    score += surfel[5] * tolerance_squared / (tolerance_squared + distance)
            if score > best_score:
                best_score = score
                best = (x, y, theta)
    return best


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
