"""Derivatives of the distances between hits and walls by the errors of a laser.

The errors are a scale of the angles between beams, an offset of the ranges, and the duration of a scan. While the robot
turns, the duration scales the angles too, in proportion to the turn rate.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, IntArray, kernel
from tbmslam.kernels.adjustment.pose_systems import LineSystem
from tbmslam.kernels.adjustment.wall_pieces import Pieces, Raster, StretchHits, piece_met
from tbmslam.kernels.rays.hits import hits_of_scan

NUMBERS = 3
"""Number of errors."""
SCALE, OFFSET, SWEEP = range(NUMBERS)
"""Relative error of the angles between beams, offset of the ranges [m], time of a beam's rotation by a radian [s]."""


class ObservedLines(NamedTuple):
    """Lines with their pieces and sightings."""

    raster: Raster
    known: Pieces
    numbers: IntArray
    """The line of each piece; -1 for none."""
    moments: FloatArray
    """The sightings, sorted by line, see `wall_pieces.sort_sightings`."""
    observers: IntArray
    begins: IntArray
    lines: FloatArray
    """The lines (L, 5) with a length, see `tbmslam.kernels.adjustment.line_adjustment.fit_lines`."""


class LaserSystem(NamedTuple):
    """The normal equations of the errors of the laser, after elimination of the lines."""

    own: FloatArray
    """Curvature (M, M) of the errors."""
    across: FloatArray
    """Mixed curvature (N, 3, M) of each pose and the errors."""
    gradient: FloatArray
    """Gradient (M,) by the errors."""


@kernel
def single_scan_hits(
    ranges: npt.NDArray[np.float32],
    offsets: IntArray,
    beams: FloatArray,
    beam_steps: FloatArray,
    chosen: IntArray,
    most: int,
    limits: tuple[float, float, float],
) -> tuple[FloatArray, IntArray]:
    """Return the hits (W, 4) of chosen scans with known normals, and the first index of each scan (N + 1,).

    A hit is its range [m], its direction in the frame of the first beam [rad], the angle of its beam from the middle of
    the scan [rad], and the direction of its normal [rad].

    Parameters
    ----------
    ranges, offsets, beams, beam_steps
        Scans as in `tbmslam.map.keyframes.Keyframes`.
    chosen
        Indices (N,) of the chosen scans.
    most
        Approximate number of beams that are used of each scan, evenly spaced.
    limits
        As of `tbmslam.kernels.adjustment.wall_pieces.gather_hits`.
    """
    size, longest = 0, 0
    for k in chosen:
        count = offsets[k + 1] - offsets[k]
        size += count // max(count // most, 1) + 1
        longest = max(longest, count)
    hits, begins = np.empty((size, 4)), np.zeros(len(chosen) + 1, dtype=np.int64)
    max_range, gap, bulge = limits
    found, wide = 0, np.empty(longest)
    for number in range(len(chosen)):
        k = chosen[number]
        own = wide[: offsets[k + 1] - offsets[k]]
        for i in range(len(own)):
            own[i] = ranges[offsets[k] + i]
        step = (beam_steps[k, 0], beam_steps[k, 1], beam_steps[k, 2])
        points, normals = hits_of_scan(own, beams[k, 0], beams[k, 1], step, max_range)
        every, apart, last, hit = max(len(own) // most, 1), max(len(points) // 180, 1), len(points) - 1, -1
        for i in range(len(own)):
            if not (own[i] <= max_range and math.isfinite(own[i])):
                continue
            hit += 1
            if i % every:
                continue
            before, after = max(hit - apart, 0), min(hit + apart, last)
            before_x, before_y = points[before, 0], points[before, 1]
            x, y, nx, ny = points[hit, 0], points[hit, 1], normals[hit, 0], normals[hit, 1]
            is_near = (points[after, 0] - before_x) ** 2 + (points[after, 1] - before_y) ** 2 <= gap * gap
            if is_near and abs(nx * (x - before_x) + ny * (y - before_y)) <= bulge:
                hits[found, 0], hits[found, 1] = math.hypot(x, y), math.atan2(y, x)
                hits[found, 2] = (i - 0.5 * (len(own) - 1)) * beams[k, 1]
                hits[found, 3] = math.atan2(ny, nx)
                found += 1
        begins[number + 1] = found
    return hits[:found], begins


@kernel
def corrected_hits(hits: FloatArray, begins: IntArray, scales: FloatArray, offset: float) -> StretchHits:
    """Return hits (W, 4) after scaling the angles of each scan by 1 + scale (N,) and adding an offset to the ranges."""
    walls = np.empty((len(hits), 3), dtype=np.float32)
    for k in range(len(scales)):
        for i in range(begins[k], begins[k + 1]):
            turn, distance = scales[k] * hits[i, 2], hits[i, 0] + offset
            walls[i, 0] = distance * math.cos(hits[i, 1] + turn)
            walls[i, 1] = distance * math.sin(hits[i, 1] + turn)
            walls[i, 2] = (hits[i, 3] + turn + math.pi) % (2.0 * math.pi) - math.pi
    return StretchHits(walls, begins, np.empty((0, 2), dtype=np.float32), np.zeros(len(begins), dtype=np.int64))


@kernel
def laser_equations(
    hits: StretchHits,
    angles: FloatArray,
    rates: FloatArray,
    poses: FloatArray,
    seen: ObservedLines,
    system: LineSystem,
    limits: tuple[float, float, float],
) -> LaserSystem:
    """Linearise the distances of all hits from their lines by the errors of the laser, and eliminate the lines.

    Parameters
    ----------
    hits
        Hits with normals (W, 3), sorted by scan.
    angles
        Angles (W,) of their beams from the middle of the scan [rad].
    rates
        Turn rate (N,) of the laser at each scan, in the direction of its beams [rad/s].
    poses
        Poses (N, 3) of the laser at the scans.
    seen
        The lines.
    system
        As of `tbmslam.kernels.adjustment.line_adjustment.line_equations`.
    limits
        The `enough`, `deviation` and `width` of `tbmslam.kernels.adjustment.line_adjustment.line_equations`.
    """
    moments, observers, begins, lines = seen.moments, seen.observers, seen.begins, seen.lines
    couplings, pulls = np.zeros((len(moments), NUMBERS, 2)), np.zeros((len(lines), 2))
    own, across, gradient = np.zeros((NUMBERS, NUMBERS)), np.zeros((len(poses), 3, NUMBERS)), np.zeros(NUMBERS)
    weights, place, slopes = _weights(poses, seen, limits), begins.copy(), np.empty(NUMBERS)
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for i in range(hits.wall_begins[k], hits.wall_begins[k + 1]):
            own_x, own_y = float(hits.walls[i, 0]), float(hits.walls[i, 1])
            x, y = c * own_x - s * own_y, s * own_x + c * own_y
            piece = piece_met(seen.known, seen.raster, poses[k, 0] + x, poses[k, 1] + y, hits.walls[i, 2] + poses[k, 2])
            line = seen.numbers[piece] if piece >= 0 else -1
            if line < 0:
                continue
            while observers[place[line]] < k:
                place[line] += 1
            o = place[line]
            px, py, lx, ly = lines[line, 0], lines[line, 1], lines[line, 2], lines[line, 3]
            dx, dy = poses[k, 0] + x - px, poses[k, 1] + y - py
            # Distance from the line, position along it, and derivatives by the scan's rotation and by the range.
            away, along = lx * dy - ly * dx, lx * dx + ly * dy
            turning, outward = lx * x + ly * y, (lx * y - ly * x) / math.hypot(x, y)
            slopes[SCALE], slopes[OFFSET], slopes[SWEEP] = angles[i] * turning, outward, rates[k] * angles[i] * turning
            for j in range(NUMBERS):
                pull = weights[o] * slopes[j]
                across[k, 0, j] -= pull * ly
                across[k, 1, j] += pull * lx
                across[k, 2, j] += pull * turning
                couplings[o, j, 0] += pull * along
                couplings[o, j, 1] -= pull
                gradient[j] += pull * away
                for other in range(NUMBERS):
                    own[j, other] += pull * slopes[other]
            pulls[line, 0] += weights[o] * along * away
            pulls[line, 1] -= weights[o] * away
    _eliminate(seen, system, couplings, pulls, LaserSystem(own, across, gradient))
    return LaserSystem(own, across, gradient)


@kernel
def _weights(poses: FloatArray, seen: ObservedLines, limits: tuple[float, float, float]) -> FloatArray:
    """Return the weight of a hit of each sighting (O,), as in `line_equations`."""
    enough, deviation, width = limits
    weights = np.empty(len(seen.moments))
    for line in range(len(seen.lines)):
        px, py, lx, ly = seen.lines[line, 0], seen.lines[line, 1], seen.lines[line, 2], seen.lines[line, 3]
        for o in range(seen.begins[line], seen.begins[line + 1]):
            k, n = seen.observers[o], seen.moments[o, 0]
            dx, dy = poses[k, 0] + seen.moments[o, 1] / n - px, poses[k, 1] + seen.moments[o, 2] / n - py
            off = (lx * dy - ly * dx) / (width * deviation)
            weights[o] = 1.0 / (deviation * deviation * (1.0 + n / enough) * (1.0 + off * off))
    return weights


@kernel
def _eliminate(
    seen: ObservedLines, system: LineSystem, couplings: FloatArray, pulls: FloatArray, laser: LaserSystem
) -> None:
    """Eliminate the rotations and translations of the lines from the equations of the laser."""
    sums = np.empty((NUMBERS, 2))
    for line in range(len(seen.lines)):
        iaa, iad, idd = system.inverses[line, 0], system.inverses[line, 1], system.inverses[line, 2]
        turn, shift = iaa * pulls[line, 0] + iad * pulls[line, 1], iad * pulls[line, 0] + idd * pulls[line, 1]
        for j in range(NUMBERS):
            sums[j, 0], sums[j, 1] = 0.0, 0.0
        for o in range(seen.begins[line], seen.begins[line + 1]):
            for j in range(NUMBERS):
                sums[j, 0] += couplings[o, j, 0]
                sums[j, 1] += couplings[o, j, 1]
        for j in range(NUMBERS):
            laser.gradient[j] -= sums[j, 0] * turn + sums[j, 1] * shift
            line_turn, line_shift = iaa * sums[j, 0] + iad * sums[j, 1], iad * sums[j, 0] + idd * sums[j, 1]
            for other in range(NUMBERS):
                laser.own[other, j] -= sums[other, 0] * line_turn + sums[other, 1] * line_shift
            for o in range(seen.begins[line], seen.begins[line + 1]):
                for axis in range(3):
                    taken = system.couplings[o, axis, 0] * line_turn + system.couplings[o, axis, 1] * line_shift
                    laser.across[seen.observers[o], axis, j] -= taken
