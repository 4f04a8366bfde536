"""Registration of a scan to surfels: the pose with the largest posterior, by Gauss-Newton."""

import math

import numpy as np

from tbmslam.kernels import FloatArray, Pose, kernel, part, summing_part
from tbmslam.kernels.arrays import cleared
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
"""The parameters of `align`."""
Placed = tuple[float, float, float, float, float, float]
"""The result of `align`; numbers are returned in a tenth of the time of arrays."""

BITS, MASK = np.uint32(TILE_BITS), np.uint32(IN_TILE)

LEADING_POINTS = 120
"""Least number of points for the wide tolerances."""

STALE = 0.3
"""Motion of points after which their surfels are looked up again [cells]."""

IN_COMMON = 0.01
"""Common share of the variance of all hits of a scan, from the errors of the heading and of whole surfaces: a thousand
hits count as less than a hundred. With 0 the mean error of the hospital drive (fr-clinic) is 1.07 m instead of 0.10 m
(`tools/benchmark.py slam`)."""

SAME_PLACE, SAME_HEADING = 0.001, 0.0005
"""Distance from a known result at which a narrow search ends [m], [rad]."""

NOWHERE = (math.nan, math.nan, math.nan)
"""A pose far from all others."""

TYPICAL_RANGE = 5.0
"""Distance of points in estimates of their motion by a rotation [m]."""


@part
def pair_up(
    surfels: SurfelArrays,
    points: FloatArray,
    normals: FloatArray,
    every: int,
    span: float,
    pose: Pose,
    pairs: FloatArray,
) -> tuple[int, float]:
    """Write every n-th point with a surfel, and the surfel, to a column of `pairs`; return the number of pairs.

    Also returns the number of independent hits of all points. Near hits on one surface have correlated errors: a hit
    counts as the ratio of its length of surface to the correlation length `span` [m], at most as one. The points (N, 2)
    [m] and normals (N, 2) are in the scan's frame, in the order of the beams. `pairs` (8, N + 1) has the point in the
    scan's frame, the mean, the information xx, xy, yy and the weight of its surfel, in rows so that sums are
    vectorised. One more column is overwritten.
    """
    tiles, _, fits, lattice, _ = surfels
    resolution, first_row, first_col = lattice
    _, tile_rows, tile_cols = tiles.shape
    rows, cols = float(tile_rows * SIDE), float(tile_cols * SIDE)
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    # The direction that separates the layers, in the scan's frame; see `layer_of`.
    facing_x, facing_y = cosine * FACING[0] + sine * FACING[1], cosine * FACING[1] - sine * FACING[0]
    inverse, count, independent = 1.0 / resolution, np.uint64(0), 0.0
    per_span, before = 0.5 / span, 0.5
    # Unsigned indices need no check for negative values.
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
        # A branch would often be mispredicted. Points without surfel are overwritten instead.
        count += np.uint64(fits[slot, 5] > 0.0)
    return int(np.int64(count)), independent  # signed, else `linearise` is compiled for several types


@summing_part
def linearise(
    pairs: FloatArray, count: int, pose: Pose, tolerance: float, hessian: FloatArray, gradient: FloatArray
) -> float:
    """Write the normal equations of the distances of a scan to its surfels.

    Returns the number of independent matching hits. For `pairs` see `pair_up`. The cost of a point with Mahalanobis
    distance d is Geman and McClure's t^2 d^2 / (t^2 + d^2), with the tolerance t in standard deviations, so distant
    points lose their influence. The pose is perturbed in the map's frame, its rotation about the sensor.
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
    """Register a scan as `align` does, and return the result and the number of its hits.

    `surfels` are the fields of a `Surfels` as a plain tuple, which is passed in a quarter of the time. `beams` are the
    direction of the first beam, the step between beams [rad], the motion from beam to beam, and the largest range of a
    hit [m]. `start` and `mean` are the initial and the prior pose of the robot, `deviations` the prior's deviations
    along, across and in heading, and `mount` is the pose of the laser on the robot. `search` and `hessian` are as for
    `align`; only every n-th hit is used, so that about `search[4]` are used. `hits` (2, N, 2) receives the hits [m] and
    their normals in the scan's frame.
    """
    angle_min, angle_increment, beam_step, max_range = beams
    count = write_hits(ranges, angle_min, angle_increment, beam_step, max_range, hits[0], hits[1])
    points, normals, information = hits[0, :count], hits[1, :count], prior_information(deviations, mean[2], mount)
    start, mean = composed(start, mount), composed(mean, mount)
    return align(surfels, points, normals, start, mean, information, search, NOWHERE, hessian), count


@part
def composed(first: Pose, second: Pose) -> Pose:
    """Return `first @ second`."""
    cosine, sine = math.cos(first[2]), math.sin(first[2])
    x, y = first[0] + cosine * second[0] - sine * second[1], first[1] + sine * second[0] + cosine * second[1]
    return x, y, _wrapped(first[2] + second[2])


@part
def _wrapped(angle: float) -> float:
    """Return the same direction within [-pi, pi)."""
    return angle if -math.pi <= angle < math.pi else (angle + math.pi) % (2.0 * math.pi) - math.pi


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
    """Register a scan to the surfels by Gauss-Newton.

    The prior of the pose is Student's t distribution. So the scan prevails over odometry that slipped, and a direction
    that the surfels do not determine keeps the prior's mean.

    Parameters
    ----------
    surfels
        The fields of a `Surfels`.
    points, normals
        As for `pair_up`.
    start
        Initial pose.
    mean, information
        The prior's mean, and its inverse scale (3, 3) in the map's frame.
    search
        The prior's degrees of freedom; correlation length of the hits [m]; largest number of independent hits in all;
        tolerances, from wide to narrow [standard deviations]; approximate number of used hits; largest number of steps
        for each tolerance.
    known
        Result of another search, or `NOWHERE`: this search ends as soon as it is near this pose.
    hessian
        (3, 3); receives the curvature of the scan's cost.

    Returns
    -------
    x, y [m] and theta [rad] of the pose, the share of matching hits, the number of independent hits, and the squared
    Mahalanobis distance from the prior's mean. The share is -1 if the search ended at the known pose.
    """
    freedom, span, most, tolerances, enough_points, iterations = search
    every = max(len(points) // enough_points, 1)
    x, y, theta = start
    gradient, step, error = cleared(np.empty(3)), cleared(np.empty(3)), cleared(np.empty(3))
    system = cleared(np.empty((3, 3)))
    pairs = np.empty((8, len(points) + 1))
    matched, independent, squared = 0.0, 0.0, 0.0
    near = STALE * surfels[3][0]
    count, moved, paired = 0, math.inf, 0
    for level in range(len(tolerances)):
        # A wide tolerance only gives the initial pose for the next tolerance.
        is_last = level == len(tolerances) - 1
        enough = 1.0 if is_last else 10.0
        stride = every if is_last else max(every, len(points) // LEADING_POINTS)
        for _ in range(iterations):
            is_near = abs(x - known[0]) < SAME_PLACE and abs(y - known[1]) < SAME_PLACE
            if is_last and is_near and abs(_wrapped(theta - known[2])) < SAME_HEADING:
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
            error[2] = _wrapped(theta - mean[2])
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
    share, counted = matched / max(independent, 1e-9), independent * _design_effect(independent, most)
    return x, y, _wrapped(theta), share, counted, squared


@part
def _design_effect(independent: float, most: float) -> float:
    """Return the weight of a hit among correlated hits (Kish, 1965), so that all hits count as at most `most` hits."""
    in_common = 1.0 / (1.0 + IN_COMMON * max(independent - 1.0, 0.0))
    return min(in_common, most / max(independent, 1e-9))


@part
def _drop_weak_direction(hessian: FloatArray, gradient: FloatArray) -> None:
    """Remove a direction of the plane that hardly any surface determines, such as the one along a corridor.

    Fitted normals have errors of a degree or two, which cause false evidence along a wall. A curvature below 1/8 % of
    that across is removed, above 3/8 % it is kept, with a ramp between. Larger limits would remove door frames too.
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
    # P = I - (1 - kept) weak weak^T does not change other directions; the system becomes P H P, P g.
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


@part
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
