"""Hits of whole drives sorted into pieces of wall.

A piece is what hits met in one cell with normals in one direction. Of the hits of one stretch of a drive on a piece
nothing but their moments is needed, whatever becomes of the poses.
"""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, IntArray, kernel


@kernel
def gather_hits(
    points: npt.NDArray[np.float32],
    normals: npt.NDArray[np.float32],
    offsets: IntArray,
    owners: IntArray,
    poses: FloatArray,
    every: int,
    gap: float,
    bulge: float,
) -> tuple[FloatArray, IntArray]:
    """Return every so manieth hit of each scan, in the frame of the stretch that owns the scan.

    A normal is kept where neighbours lie near and on one line with the hit. At a door frame they lie on walls at
    different depths: the slanted wall between them is none, and would move along with the robot.

    Parameters
    ----------
    points, normals
        Hits and normals (P, 2) in the sensors' frames.
    offsets
        Where each scan begins among them, and where the last one ends (K + 1,).
    owners
        Stretch (K,) of each scan.
    poses
        Poses (K, 3) of the sensors in the stretches' frames.
    every
        One takes all.
    gap, bulge
        How far apart neighbours may be, and how far a hit from the line between them [m].

    Returns
    -------
    Points and normals (M, 4), zeros where none is known, and the stretch (M,) of each.
    """
    size = 0
    for k in range(len(offsets) - 1):
        size += (offsets[k + 1] - offsets[k] + every - 1) // every
    hits, of = np.zeros((size, 4)), np.empty(size, dtype=np.int64)
    count = 0
    for k in range(len(offsets) - 1):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        first, last = offsets[k], offsets[k + 1] - 1
        apart = max((last + 1 - first) // 180, 1)
        for i in range(first, last + 1, every):
            x, y, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
            before, after = points[max(i - apart, first)], points[min(i + apart, last)]
            is_near = math.hypot(after[0] - before[0], after[1] - before[1]) <= gap
            hits[count, 0], hits[count, 1] = poses[k, 0] + c * x - s * y, poses[k, 1] + s * x + c * y
            if is_near and abs(nx * (x - before[0]) + ny * (y - before[1])) <= bulge:
                hits[count, 2], hits[count, 3] = c * nx - s * ny, s * nx + c * ny
            of[count] = owners[k]
            count += 1
    return hits, of


@kernel
def pieces_of(
    hits: FloatArray, owners: IntArray, poses: FloatArray, cell: float, shift: float, sectors: int
) -> tuple[IntArray, IntArray]:
    """Return the piece (M,) that each hit belongs to, by its cell and by where its normal points, and its cell (M,).

    Pieces of a cell have consecutive numbers beginning with the cell's number times `sectors`; a hit without normal
    belongs to -1.

    Parameters
    ----------
    hits
        Points and normals (M, 4) in the frames of the stretches `owners` (M,).
    poses
        Poses (N, 3) of the stretches.
    cell, shift
        Side of a cell, and where the cells begin [m].
    sectors
        Directions that are told apart.
    """
    places, pieces = np.empty((len(hits), 2), dtype=np.int64), np.full(len(hits), -1)
    low, high = np.full(2, np.iinfo(np.int64).max), np.full(2, np.iinfo(np.int64).min)
    for i in range(len(hits)):
        pose = poses[owners[i]]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        x, y, nx, ny = hits[i]
        places[i, 0] = math.floor((pose[0] + c * x - s * y - shift) / cell)
        places[i, 1] = math.floor((pose[1] + s * x + c * y - shift) / cell)
        for axis in range(2):
            low[axis], high[axis] = min(low[axis], places[i, axis]), max(high[axis], places[i, axis])
        if nx != 0.0 or ny != 0.0:
            turn = math.atan2(s * nx + c * ny, c * nx - s * ny) / (2.0 * math.pi)
            pieces[i] = math.floor(turn * sectors + 0.5) % sectors
    cells = np.empty(len(hits), dtype=np.int64)
    for i in range(len(hits)):
        cells[i] = (places[i, 1] - low[1]) * (high[0] - low[0] + 1) + places[i, 0] - low[0]
        if pieces[i] >= 0:
            pieces[i] += cells[i] * sectors
    return pieces, cells


@kernel
def join_lines(
    hits: FloatArray,
    owners: IntArray,
    poses: FloatArray,
    pieces: IntArray,
    cells: IntArray,
    known: IntArray,
    lines: FloatArray,
    sectors: int,
    reach: float,
) -> IntArray:
    """Return the pieces (M,) of hits, those without normal on the only line of their cell that can be what they met.

    It faces who saw them, and they lie beside what is known of it: a line goes on where its wall may have ended.

    Parameters
    ----------
    hits, owners, poses
        As of `pieces_of`.
    pieces, cells
        What it returned.
    known
        Rising numbers (L,) of the pieces that there are.
    lines
        Theirs (L, 5), see `tbmslam.kernels.line_adjustment.fit_lines`.
    sectors
        Directions that are told apart.
    reach
        How far a hit may lie from a line [m].
    """
    joined = pieces.copy()
    for i in range(len(hits)):
        if pieces[i] >= 0:
            continue
        pose = poses[owners[i]]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        dx, dy = c * hits[i, 0] - s * hits[i, 1], s * hits[i, 0] + c * hits[i, 1]
        x, y, distance = pose[0] + dx, pose[1] + dy, math.hypot(dx, dy)
        met = 0
        at = np.searchsorted(known, cells[i] * sectors)
        while at < len(known) and known[at] < (cells[i] + 1) * sectors:
            px, py, lx, ly, half = lines[at]
            towards = 2.0 * math.pi * (known[at] % sectors) / sectors
            nx, ny = -ly, lx
            if nx * math.cos(towards) + ny * math.sin(towards) < 0.0:
                nx, ny = ly, -lx
            is_beside = abs(lx * (x - px) + ly * (y - py)) <= half
            is_faced = -(nx * dx + ny * dy) > 0.02 * distance
            if is_beside and is_faced and abs(nx * (x - px) + ny * (y - py)) <= reach:
                met += 1
                joined[i] = known[at] if met == 1 else -1
            at += 1
    return joined


@kernel
def sum_moments(
    hits: FloatArray, owners: IntArray, numbers: IntArray, order: IntArray
) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """Add up the hits of each stretch on each piece.

    Parameters
    ----------
    hits, owners, numbers
        Points and normals (M, 4), the stretch and the piece (M,) of each.
    order
        The hits in the order of their pieces, and within one of their stretches.

    Returns
    -------
    moments
        Of each sighting: count, sums of x, y, x^2, xy, y^2 (O, 6) in the frame of the stretch.
    seers
        Its stretch (O,).
    begins
        Where the sightings of each piece begin, and where the last ones end (L + 1,).
    known
        The pieces (L,), rising.
    """
    moments, seers = np.zeros((len(hits), 6)), np.empty(len(hits), dtype=np.int64)
    begins, known = np.empty(len(hits) + 1, dtype=np.int64), np.empty(len(hits), dtype=np.int64)
    count, pieces = 0, 0
    for k in range(len(order)):
        i = order[k]
        before = order[k - 1]
        is_new_piece = k == 0 or numbers[i] != numbers[before]
        if is_new_piece:
            begins[pieces], known[pieces] = count, numbers[i]
            pieces += 1
        if is_new_piece or owners[i] != owners[before]:
            seers[count] = owners[i]
            count += 1
        x, y, sums = hits[i, 0], hits[i, 1], moments[count - 1]
        sums[0] += 1.0
        sums[1] += x
        sums[2] += y
        sums[3] += x * x
        sums[4] += x * y
        sums[5] += y * y
    begins[pieces] = count
    return moments[:count].copy(), seers[:count].copy(), begins[: pieces + 1].copy(), known[:pieces].copy()
