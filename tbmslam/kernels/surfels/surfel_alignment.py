"""A scan moved onto surface elements: the pose of the largest posterior, by Gauss and Newton's steps."""

import math
from typing import cast

import numpy as np

from tbmslam.kernels import FloatArray, Pose, kernel, summing_kernel
from tbmslam.kernels.rays.hits import write_hits
from tbmslam.kernels.surfels.determined import prior_information
from tbmslam.kernels.surfels.surfels import (
    CELLS,
    FACING,
    IN_TILE,
    SIDE,
    TILE_BITS,
    SurfelArrays,
    fit_surfel,
)

Beams = tuple[float, float, Pose, float]
"""Direction of the first beam, step between beams [rad], motion from beam to beam, largest range [m]."""
Search = tuple[float, float, float, FloatArray, int, int]
"""What `align` is told of the search."""
Placed = tuple[float, float, float, float, float, float]
"""What `align` returns; numbers come out in a tenth of the time of arrays, which it writes to."""

BITS, MASK = np.uint32(TILE_BITS), np.uint32(IN_TILE)

LEADING_POINTS = 120
"""Points that lead through the wide tolerances, at least."""

STALE = 0.3
"""Part of a cell that points move by before their surfels are looked up anew."""

IN_COMMON = 0.01
"""Share of their variance that all hits of a scan have in common, since the laser's heading and the surfaces err as
wholes: a thousand hits count for less than a hundred. With 0 the hospital drive (fr-clinic) is off by 1.07 m in the
mean instead of 0.10 m (`tools/benchmark.py slam`)."""

SAME_PLACE, SAME_HEADING = 0.001, 0.0005
"""A narrow search so near to where another one ended would end there, too [m], [rad]."""

NOWHERE = (math.nan, math.nan, math.nan)
"""A pose that nothing is near to."""

_EACH = cast("int", np.int64(1))
"""As a plain number it would be a constant, for which what it is passed to is compiled anew."""

TYPICAL_RANGE = 5.0
"""Distance of points by which a turn moves them, as far as that matters [m]."""


@kernel
def pair_up(
    surfels: SurfelArrays,
    points: FloatArray,
    normals: FloatArray,
    every: int,
    span: float,
    pose: Pose,
    pairs: FloatArray,
) -> tuple[int, float]:
    """Write every n-th point that has a surfel, and the surfel, to a column of `pairs`.

    Hits of one surface err alike where they are near each other: a hit counts as many independent ones as the length of
    surface that it stands for holds correlation lengths, and one at the most.

    Parameters
    ----------
    points, normals
        Points (N, 2) [m] in the order of the beams and the normals (N, 2) of what was hit, in the scan's frame.
    every
        Which n that is.
    span
        Correlation length [m].
    pose
        Where the scan lies.
    pairs
        (8, N + 1): a point in the scan's frame, its surfel's mean, information xx, xy, yy, and weight, in rows so that
        sums over them are vectorised. A column more is written over.

    Returns
    -------
    How many pairs there are, and how many independent hits all the points count for.
    """
    tiles, _, fits, lattice, _ = surfels
    resolution, first_row, first_col = lattice
    _, tile_rows, tile_cols = tiles.shape
    rows, cols = float(tile_rows * SIDE), float(tile_cols * SIDE)
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    # What tells the layers apart, in the scan's frame; see `layer_of`.
    facing_x, facing_y = cosine * FACING[0] + sine * FACING[1], cosine * FACING[1] - sine * FACING[0]
    inverse, count, independent = 1.0 / resolution, np.uint64(0), 0.0
    per_span, before = 0.5 / span, 0.5
    # Negative indices count from the end. Unsigned ones need no check for that.
    stop, step = np.uint64(len(points)), np.uint64(every)
    for i in range(np.uint64(0), stop, step):
        px, py = points[i, 0], points[i, 1]
        after = 0.5
        if i + step < stop:
            dx, dy = points[i + step, 0] - px, points[i + step, 1] - py
            after = min(per_span * math.sqrt(dx * dx + dy * dy), 0.5)
        share = before + after
        before = after
        independent += share
        cell_x = (x + cosine * px - sine * py) * inverse - first_col
        cell_y = (y + sine * px + cosine * py) * inverse - first_row
        if not (0.0 <= cell_x < cols and 0.0 <= cell_y < rows):
            continue
        col, row = np.uint32(cell_x), np.uint32(cell_y)
        layer = 1 if normals[i, 0] * facing_x + normals[i, 1] * facing_y > 0.0 else 0
        tile = np.uint32(tiles[layer, row >> BITS, col >> BITS])
        slot = tile * np.uint32(CELLS) + (row & MASK) * np.uint32(SIDE) + (col & MASK)
        if fits[slot, 5] < 0.0:
            fit_surfel(surfels, layer, int(cell_y), int(cell_x))  # as of others: for 32 bits it is compiled anew
        pairs[0, count], pairs[1, count] = px, py
        for k in range(5):
            pairs[2 + k, count] = fits[slot, k]
        pairs[7, count] = share * fits[slot, 5]
        # A branch would be guessed wrongly too often: what has no surfel is written over.
        count += np.uint64(fits[slot, 5] > 0.0)
    return int(count), independent


@summing_kernel
def linearise(
    pairs: FloatArray, count: int, pose: Pose, tolerance: float, hessian: FloatArray, gradient: FloatArray
) -> float:
    """Fill the normal equations of a scan's distance to its surfels; return how many independent hits match.

    `pairs` are as `pair_up` writes them. The cost of a point is Geman and McClure's t^2 d^2 / (t^2 + d^2) of its
    Mahalanobis distance d, with the tolerance t in standard deviations: far points lose their influence. The pose is
    perturbed in the map's frame, its rotation about the sensor.
    """
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    squared = tolerance * tolerance
    pxs, pys, mean_xs, mean_ys = pairs[0], pairs[1], pairs[2], pairs[3]
    info_xx, info_xy, info_yy, weights = pairs[4], pairs[5], pairs[6], pairs[7]
    xx, xy, yy, xt, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sum_x, sum_y, sum_t, matched = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        px, py = pxs[i], pys[i]
        rx, ry = cosine * px - sine * py, sine * px + cosine * py
        dx, dy = x + rx - mean_xs[i], y + ry - mean_ys[i]
        ixx, ixy, iyy = info_xx[i], info_xy[i], info_yy[i]
        gx, gy = ixx * dx + ixy * dy, ixy * dx + iyy * dy
        influence = squared / (squared + dx * gx + dy * gy)
        weight = weights[i] * influence
        matched += weight
        weight *= influence
        # d(point)/d(theta) = (-ry, rx)
        jx, jy = ixy * rx - ixx * ry, iyy * rx - ixy * ry
        xx += weight * ixx
        xy += weight * ixy
        yy += weight * iyy
        xt += weight * jx
        yt += weight * jy
        tt += weight * (rx * jy - ry * jx)
        sum_x += weight * gx
        sum_y += weight * gy
        sum_t += weight * (rx * gy - ry * gx)
    hessian[0, 0], hessian[1, 1], hessian[2, 2] = xx, yy, tt
    hessian[0, 1] = hessian[1, 0] = xy
    hessian[0, 2] = hessian[2, 0] = xt
    hessian[1, 2] = hessian[2, 1] = yt
    gradient[0], gradient[1], gradient[2] = sum_x, sum_y, sum_t
    return matched


@kernel
def place_scan(
    surfels: SurfelArrays,
    ranges: FloatArray,
    beams: Beams,
    start: Pose,
    mean: Pose,
    deviations: Pose,
    mount: Pose,
    search: Search,
    hits: FloatArray,
    hessian: FloatArray,
) -> tuple[Placed, int]:
    """Return where a scan lies as `align` does, and how many hits it has.

    Parameters
    ----------
    surfels
        The fields of a `Surfels`, which come in in a quarter of the time as a plain tuple.
    ranges, beams
        Ranges (N,), direction of the first beam, step between beams [rad], motion from beam to beam, and the range up
        to which hits count [m].
    start, mean, deviations
        Where the robot is thought to be, first and by the prior, and the prior's deviations along, across and in
        heading.
    mount
        Pose of the laser on the robot.
    search
        As for `align`; every so many hits is used that not many more than `search[4]` are.
    hits
        (2, N, 2), written to: the hits [m] and their normals, in the scan's frame.
    hessian
        As for `align`.
    """
    angle_min, angle_increment, beam_step, max_range = beams
    count = write_hits(ranges, angle_min, angle_increment, beam_step, max_range, hits[0], hits[1])
    points, normals, information = hits[0, :count], hits[1, :count], prior_information(deviations, mean[2], mount)
    start, mean = composed(start, mount), composed(mean, mount)
    return align(surfels, points, normals, start, mean, information, search, NOWHERE, hessian), count


@kernel
def composed(first: Pose, second: Pose) -> Pose:
    """Return `first @ second`, the heading not wrapped."""
    cosine, sine = math.cos(first[2]), math.sin(first[2])
    x, y = first[0] + cosine * second[0] - sine * second[1], first[1] + sine * second[0] + cosine * second[1]
    return x, y, first[2] + second[2]


@kernel
def align(
    surfels: SurfelArrays,
    points: FloatArray,
    normals: FloatArray,
    start: Pose,
    mean: Pose,
    information: FloatArray,
    search: Search,
    known: Pose,
    hessian: FloatArray,
) -> Placed:
    """Move a scan onto the surfels by Gauss-Newton.

    The pose has a prior of Student's t distribution: the scan is believed where an odometry that slipped is far off,
    and a direction that the surfels do not determine keeps the mean.

    Parameters
    ----------
    surfels
        The fields of a `Surfels`.
    points, normals
        As for `pair_up`.
    start
        Where the search begins.
    mean, information
        The prior's mean, and its inverse scale (3, 3) in the map's frame.
    search
        The prior's degrees of freedom; correlation length of the hits [m]; how many independent hits all of them count
        for at the most; distances at which a hit loses its influence [standard deviations], worked through from wide
        to narrow; how many hits are used, about; steps for each tolerance, at the most.
    known
        A pose that another search ended at, `NOWHERE` for none: this search ends there, too, once it is so near.
    hessian
        (3, 3), written to: the curvature of the scan's cost alone.

    Returns
    -------
    The pose's x, y [m] and theta [rad], the share of the hits that match, how many independent hits they count for, and
    the squared Mahalanobis distance from the prior's mean. The share is -1 where the search ended at the known pose.
    """
    freedom, span, most, tolerances, enough_points, iterations = search
    every = max(len(points) // enough_points, 1)
    x, y, theta = start
    gradient, system, step, error = np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    pairs = np.empty((8, len(points) + 1))
    matched, independent, squared = 0.0, 0.0, 0.0
    near = STALE * surfels[3][0]
    count, moved, paired = 0, math.inf, 0
    for level in range(len(tolerances)):
        # A wide tolerance only leads to where the next one starts.
        is_last = level == len(tolerances) - 1
        enough = 1.0 if is_last else 10.0
        stride = every if is_last else max(every, len(points) // LEADING_POINTS)
        for _ in range(iterations):
            is_near = abs(x - known[0]) < SAME_PLACE and abs(y - known[1]) < SAME_PLACE
            if is_last and is_near and abs(theta - known[2]) < SAME_HEADING:
                return known[0], known[1], known[2], -1.0, 0.0, 0.0
            if moved > near or paired != stride:
                count, independent = pair_up(surfels, points, normals, stride, span, (x, y, theta), pairs)
                moved, paired = 0.0, stride
            matched = linearise(pairs, count, (x, y, theta), tolerances[level], hessian, gradient)
            scale = _design_effect(independent, most)
            for a in range(3):
                gradient[a] *= scale
                for b in range(3):
                    hessian[a, b] *= scale
            _drop_weak_direction(hessian, gradient)
            error[0], error[1] = x - mean[0], y - mean[1]
            error[2] = (theta - mean[2] + math.pi) % (2.0 * math.pi) - math.pi
            squared = 0.0
            for a in range(3):
                step[a] = information[a, 0] * error[0] + information[a, 1] * error[1] + information[a, 2] * error[2]
                squared += error[a] * step[a]
            weight = (freedom + 3.0) / (freedom + squared)
            for a in range(3):
                gradient[a] += weight * step[a]
                for b in range(3):
                    system[a, b] = hessian[a, b] + weight * information[a, b]
            _solve(system, gradient, step)
            x, y, theta = x - step[0], y - step[1], theta - step[2]
            shift, turn = max(abs(step[0]), abs(step[1])), abs(step[2])
            moved += shift + TYPICAL_RANGE * turn
            if shift < enough * 2e-4 and turn < enough * 2e-5:
                break
    return x, y, theta, matched / max(independent, 1e-9), independent * _design_effect(independent, most), squared


@kernel
def strays(
    surfels: SurfelArrays, points: FloatArray, normals: FloatArray, pose: Pose, span: float, tolerance: float
) -> float:
    """Return how many independent hits of a scan at a pose match no surfel.

    Parameters
    ----------
    surfels, points, normals, pose
        As for `align` and `pair_up`.
    span
        Length of surface that counts as one hit [m].
    tolerance
        Distance at which a hit counts half [standard deviations].
    """
    pairs, hessian, gradient = np.empty((8, len(points) + 1)), np.zeros((3, 3)), np.zeros(3)
    count, independent = pair_up(surfels, points, normals, _EACH, span, pose, pairs)
    return independent - linearise(pairs, count, pose, tolerance, hessian, gradient)


@kernel
def _design_effect(independent: float, most: float) -> float:
    """Return what a hit counts for where so many have some of their errors in common (Kish, 1965).

    At the most `most` hits count altogether.
    """
    in_common = 1.0 / (1.0 + IN_COMMON * max(independent - 1.0, 0.0))
    return min(in_common, most / max(independent, 1e-9))


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
    weak = (-math.sin(angle), math.cos(angle))
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
