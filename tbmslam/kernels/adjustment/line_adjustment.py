"""Joint adjustment of wall lines and of the stretches of drives that observed them.

The two unknowns of each line are eliminated (Schur complement), so only poses are left as unknowns. The matrix is never
computed: for each sighting of a line only its coupling with the pose is stored.
"""

import math

import numpy as np

from tbmslam.kernels import FloatArray, IntArray, kernel
from tbmslam.kernels.adjustment.pose_systems import LineSystem
from tbmslam.kernels.adjustment.wall_pieces import Sightings
from tbmslam.kernels.arrays import cleared


@kernel
def fit_lines(seen: Sightings, poses: FloatArray, enough: float, limits: FloatArray) -> FloatArray:
    """Return the line (L, 5) of each piece: middle, direction and half length [m]; zeros if the piece is not a line.

    `poses` (N, 3) are those of the stretches. Beyond `enough` hits of a sighting, further hits add little weight.
    `limits` are the least sum of weighted hits, the largest standard deviation across the line, and the least one along
    it [m]. A line also needs two sightings, and a variance along it of ten times that across.
    """
    # For each piece: number of sightings, position of the first observer, and weighted moments relative to it.
    sums = cleared(np.empty((seen.pieces_met, 9)))
    moments, observers, pieces = seen.moments, seen.observers, seen.pieces
    for o in range(seen.size):
        piece, count, x, y = pieces[o], moments[o, 0], moments[o, 1], moments[o, 2]
        place_x, place_y = poses[observers[o], 0], poses[observers[o], 1]
        if sums[piece, 0] == 0.0:
            sums[piece, 1], sums[piece, 2] = place_x, place_y
        weight = 1.0 / (1.0 + count / enough)
        dx, dy = place_x - sums[piece, 1], place_y - sums[piece, 2]
        sums[piece, 0] += 1.0
        sums[piece, 3] += weight * count
        sums[piece, 4] += weight * (x + count * dx)
        sums[piece, 5] += weight * (y + count * dy)
        sums[piece, 6] += weight * (moments[o, 3] + 2.0 * x * dx + count * dx * dx)
        sums[piece, 7] += weight * (moments[o, 4] + x * dy + y * dx + count * dx * dy)
        sums[piece, 8] += weight * (moments[o, 5] + 2.0 * y * dy + count * dy * dy)
    lines = cleared(np.empty((seen.pieces_met, 5)))
    for piece in range(len(lines)):
        saw, x0, y0, n = sums[piece, 0], sums[piece, 1], sums[piece, 2], sums[piece, 3]
        if saw < 2.0 or n < limits[0]:  # a single sighting does not constrain the poses
            continue
        mx, my = sums[piece, 4] / n, sums[piece, 5] / n
        cxx, cxy, cyy = sums[piece, 6] / n - mx * mx, sums[piece, 7] / n - mx * my, sums[piece, 8] / n - my * my
        spread = math.hypot(0.5 * (cxx - cyy), cxy)
        across, along = max(0.5 * (cxx + cyy) - spread, 0.0), 0.5 * (cxx + cyy) + spread
        if across > limits[1] ** 2 or along < limits[2] ** 2 or across > 0.1 * along:
            continue
        angle = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
        lines[piece, 0], lines[piece, 1] = x0 + mx, y0 + my
        lines[piece, 2], lines[piece, 3] = math.cos(angle), math.sin(angle)
        lines[piece, 4] = math.sqrt(3.0 * along)  # for evenly distributed hits
    return lines


@kernel
def line_equations(
    moments: FloatArray,
    observers: IntArray,
    begins: IntArray,
    lines: FloatArray,
    poses: FloatArray,
    enough: float,
    deviation: float,
    width: float,
) -> tuple[FloatArray, LineSystem, FloatArray]:
    """Linearise the distances of all hits from their lines, and eliminate the lines.

    Parameters
    ----------
    moments, observers, begins
        The sightings, sorted by line, see `wall_pieces.sort_sightings`.
    lines
        Lines (L, 5), see `fit_lines`; lines without length are ignored.
    poses
        Poses (N, 3) of the stretches. A small change of a pose is dx, dy in the map's frame and dtheta about its
        position.
    enough
        Number of hits of a sighting beyond which further hits add little weight.
    deviation
        Standard deviation of a hit from its line [m].
    width
        Width of the Cauchy loss of a sighting's mean [standard deviations].

    Returns
    -------
    blocks
        Curvature (N, 3, 3) with all lines fixed.
    system
        The curvature that the elimination of the lines removes.
    gradient
        Gradient (N, 3) after the elimination.
    """
    blocks, gradient = cleared(np.empty((len(poses), 3, 3))), cleared(np.empty((len(poses), 3)))
    couplings, inverses = cleared(np.empty((len(moments), 3, 2))), cleared(np.empty((len(lines), 3)))
    for piece in range(len(lines)):
        px, py, lx, ly = lines[piece, 0], lines[piece, 1], lines[piece, 2], lines[piece, 3]
        if lines[piece, 4] == 0.0:
            continue
        nx, ny = -ly, lx
        caa, cad, cdd, ga, gd = 1e-6, 0.0, 1e-6, 0.0, 0.0
        for o in range(begins[piece], begins[piece + 1]):
            k = observers[o]
            n, x, y = moments[o, 0], moments[o, 1], moments[o, 2]
            xx, xy, yy = moments[o, 3], moments[o, 4], moments[o, 5]
            dx, dy = poses[k, 0] - px, poses[k, 1] - py
            across, along = nx * dx + ny * dy, lx * dx + ly * dy
            # Sums over the hits of the distance e from the line, the position a along it, and the lever t of a
            # rotation.
            sn, sl, st = nx * x + ny * y, lx * x + ly * y, ny * x - nx * y
            nl = nx * lx * xx + (nx * ly + ny * lx) * xy + ny * ly * yy
            ll = lx * lx * xx + 2.0 * lx * ly * xy + ly * ly * yy
            nt = nx * ny * xx + (ny * ny - nx * nx) * xy - nx * ny * yy
            lt = lx * ny * xx + (ly * ny - lx * nx) * xy - ly * nx * yy
            tt = ny * ny * xx - 2.0 * nx * ny * xy + nx * nx * yy
            e, ee_mean = sn + n * across, (sn + n * across) / n
            a, aa = sl + n * along, ll + 2.0 * along * sl + n * along * along
            ea = nl + along * sn + across * sl + n * across * along
            et, at = nt + across * st, lt + along * st
            off = ee_mean / (width * deviation)
            w = 1.0 / (deviation * deviation * (1.0 + n / enough) * (1.0 + off * off))
            block = blocks[k]
            block[0, 0] += w * n * nx * nx
            block[0, 1] += w * n * nx * ny
            block[1, 1] += w * n * ny * ny
            block[0, 2] += w * nx * st
            block[1, 2] += w * ny * st
            block[2, 2] += w * tt
            gradient[k, 0] += w * nx * e
            gradient[k, 1] += w * ny * e
            gradient[k, 2] += w * et
            coupling = couplings[o]
            coupling[0, 0], coupling[0, 1] = w * nx * a, -w * nx * n
            coupling[1, 0], coupling[1, 1] = w * ny * a, -w * ny * n
            coupling[2, 0], coupling[2, 1] = w * at, -w * st
            caa += w * aa
            cad -= w * a
            cdd += w * n
            ga += w * ea
            gd -= w * e
        determinant = caa * cdd - cad * cad
        iaa, iad, idd = cdd / determinant, -cad / determinant, caa / determinant
        inverses[piece, 0], inverses[piece, 1], inverses[piece, 2] = iaa, iad, idd
        turn, shift = iaa * ga + iad * gd, iad * ga + idd * gd
        for o in range(begins[piece], begins[piece + 1]):
            for axis in range(3):
                gradient[observers[o], axis] -= couplings[o, axis, 0] * turn + couplings[o, axis, 1] * shift
    for k in range(len(poses)):
        blocks[k, 1, 0], blocks[k, 2, 0], blocks[k, 2, 1] = blocks[k, 0, 1], blocks[k, 0, 2], blocks[k, 1, 2]
    return blocks, LineSystem(couplings, inverses, observers, begins), gradient
