"""Grouping of the hits of whole drives into pieces of wall.

A piece contains the hits in one cell with similar normals. A sighting contains the hits of one stretch of a drive on a
piece; only their moments are stored.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, IntArray, kernel, part
from tbmslam.kernels.arrays import cleared

_NOBODY = np.iinfo(np.int64).min
_FEWEST = 1024
"""Initial size of a hash table."""


class StretchHits(NamedTuple):
    """Hits of drives in the frames of their stretches, in single precision, sorted by stretch."""

    walls: npt.NDArray[np.float32]
    """Hits with known normals (W, 3): x, y [m], and direction of the normal [rad]."""
    wall_begins: IntArray
    """First index of each stretch, and the end of the last stretch (N + 1,)."""
    loose: npt.NDArray[np.float32]
    """The other hits (M, 2): x, y [m]."""
    loose_begins: IntArray
    """As `wall_begins`."""


class Raster(NamedTuple):
    """The cells and directions of pieces."""

    cell: float
    """Side of a cell [m]."""
    shift: float
    """Offset of the cells in x and in y [m]."""
    sectors: int
    """Number of directions."""


class Pieces(NamedTuple):
    """Index of the pieces of wall by cell and direction."""

    cells: IntArray
    """Open hash table (T, 2) whose size is a power of two: the key and the number of each cell."""
    numbers: IntArray
    """The piece at index (number of the cell * sectors + direction); -1 for none."""


class Sightings(NamedTuple):
    """Sightings of pieces, in arrays with capacity for more."""

    size: int
    """Number of sightings."""
    pieces_met: int
    """Of how many pieces."""
    moments: FloatArray
    """Of each (O, 6): count of hits, sums of x, y, x^2, xy, y^2 from the stretch's place, along the map's axes [m]."""
    observers: IntArray
    """Its stretch (O,)."""
    pieces: IntArray
    """The piece (O,) of each sighting."""


@kernel
def gather_hits(
    points: npt.NDArray[np.float32],
    normals: npt.NDArray[np.float32],
    offsets: IntArray,
    places: FloatArray,
    every: int,
    limits: tuple[float, float, float],
) -> tuple[StretchHits, npt.NDArray[np.float32]]:
    """Return every n-th hit of each scan in the frame of the scan's stretch, sorted by scan.

    The directions of the normals are returned as cosines and, separately, sines (W,): NumPy computes many angles in a
    twentieth of the time.

    A normal is known if the neighbours of a hit are near and on one line with it. At a door frame they lie on walls of
    different depth, and the apparent wall between them would move with the robot.

    `points` and `normals` (P, 2) are in the frames of the sensors, and `places` (K, 3) are the poses of the sensors in
    the frames of the stretches. `offsets` (K + 1,) are the first index of each scan, and the end of the last scan.
    `every` is the n. `limits` are the largest range of a hit, the largest distance between its neighbours, and the
    largest distance from the line between them [m].
    """
    size = 0
    for k in range(len(places)):
        size += (offsets[k + 1] - offsets[k] + every - 1) // every
    walls, loose = np.empty((size, 3), dtype=np.float32), np.empty((size, 2), dtype=np.float32)
    sines = np.empty(size, dtype=np.float32)
    wall_begins, loose_begins = (
        cleared(np.empty(len(offsets), dtype=np.int64)),
        cleared(np.empty(len(offsets), dtype=np.int64)),
    )
    max_range, gap, bulge = limits
    known, unknown = 0, 0
    for k in range(len(places)):
        c, s = math.cos(places[k, 2]), math.sin(places[k, 2])
        first, last = offsets[k], offsets[k + 1] - 1
        apart = max((last + 1 - first) // 180, 1)
        for i in range(first, last + 1, every):
            x, y, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
            if x * x + y * y > max_range * max_range:
                continue
            before, after = max(i - apart, first), min(i + apart, last)
            before_x, before_y = points[before, 0], points[before, 1]
            is_near = (points[after, 0] - before_x) ** 2 + (points[after, 1] - before_y) ** 2 <= gap * gap
            there_x, there_y = places[k, 0] + c * x - s * y, places[k, 1] + s * x + c * y
            if is_near and abs(nx * (x - before_x) + ny * (y - before_y)) <= bulge:
                walls[known, 0], walls[known, 1] = there_x, there_y
                walls[known, 2], sines[known] = c * nx - s * ny, s * nx + c * ny
                known += 1
            else:
                loose[unknown, 0], loose[unknown, 1] = there_x, there_y
                unknown += 1
        wall_begins[k + 1], loose_begins[k + 1] = known, unknown
    return StretchHits(walls[:known], wall_begins, loose[:unknown], loose_begins), sines[:known]


@kernel
def see_walls(hits: StretchHits, every: int, poses: FloatArray, raster: Raster) -> tuple[Sightings, Pieces]:
    """Group hits with known normals into pieces, numbered in the order of their first hits.

    Only every n-th hit of a stretch is used. The poses (N, 3) of the stretches have headings in [-pi, pi].
    """
    walls, begins, sectors = hits.walls, hits.wall_begins, raster.sectors
    size = (begins[-1] + hits.loose_begins[-1]) // every + 2 * len(poses)  # the rest of each stretch is rounded up
    moments, observers, pieces = np.empty((size, 6)), np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    latest = np.empty(size, dtype=np.int64)
    table, numbers = np.empty((_FEWEST, 2), dtype=np.int64), np.empty(_FEWEST // 2 * sectors, dtype=np.int64)
    table[...], numbers[:] = _NOBODY, -1
    most = _most(begins)
    placed, keys, facing = np.empty((2, most)), np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    count, cells, pieces_met = 0, 0, 0
    for k in range(len(poses)):
        first, here = count, begins[k]
        while 2 * (cells + begins[k + 1] - here) > len(table):  # room for a cell for each hit
            table, numbers = _grown(table, numbers)
        used = _place_hits(walls, here, begins[k + 1], every, poses[k], raster, placed, keys)
        for j in range(np.uint64(used)):
            facing[j] = _sector_of(walls[np.uint64(here) + j * np.uint64(every), 2] + poses[k, 2], sectors)
        for j in range(np.uint64(used)):
            place = _place_of(table, keys[j])
            if table[place, 0] == _NOBODY:
                table[place, 0], table[place, 1] = keys[j], cells
                cells += 1
            at = np.uint64(table[place, 1] * sectors + facing[j])
            piece = numbers[at]
            if piece < 0:
                numbers[at] = piece = pieces_met
                latest[piece] = -1
                pieces_met += 1
            o = latest[np.uint64(piece)]
            if o < first:
                latest[piece] = o = count
                observers[o], pieces[o] = k, piece
                for m in range(6):
                    moments[o, m] = 0.0
                count += 1
            _add_hit(moments, o, placed[0, j], placed[1, j])
    return Sightings(count, pieces_met, moments, observers, pieces), Pieces(table, numbers)


@part
def lines_by_cell(known: Pieces, lines: FloatArray, sectors: int) -> tuple[IntArray, IntArray]:
    """Return where the lines of each cell begin and end (C + 1,), and the pieces whose lines they are.

    This reverses the directions of lines (L, 5), see `line_adjustment.fit_lines`, so that their pieces face left.
    """
    begins, members = (
        cleared(np.empty(len(known.numbers) // sectors + 1, dtype=np.int64)),
        np.empty(len(lines), dtype=np.int64),
    )
    count = 0
    for at in range(len(known.numbers)):
        piece = known.numbers[at]
        if piece >= 0 and lines[piece, 4] > 0.0:
            towards = 2.0 * math.pi * (at % sectors) / sectors
            if lines[piece, 2] * math.sin(towards) - lines[piece, 3] * math.cos(towards) < 0.0:
                lines[piece, 2], lines[piece, 3] = -lines[piece, 2], -lines[piece, 3]
            members[count] = piece
            count += 1
        begins[at // sectors + 1] = count
    return begins, members[:count]


@kernel
def join_walls(
    hits: StretchHits,
    every: int,
    poses: FloatArray,
    raster: Raster,
    seen: Sightings,
    known: Pieces,
    lines: FloatArray,
    reach: float,
) -> Sightings:
    """Add each hit without normal to a sighting if it can lie on exactly one line of its cell.

    That line must face the observer, and the hit must lie within `reach` of the line [m] and within its known length.
    `seen` and `known` are the result of `see_walls`; for the lines (L, 5) of the pieces see `lines_by_cell`.
    """
    loose, begins = hits.loose, hits.loose_begins
    count, pieces_met, moments, observers, pieces = seen
    latest = np.empty(len(lines), dtype=np.int64)
    latest[:] = -1
    firsts, members = lines_by_cell(known, lines, raster.sectors)
    placed, keys = np.empty((2, _most(begins))), np.empty(_most(begins), dtype=np.int64)
    had, own = count, 0
    for k in range(len(poses)):
        while own < had and observers[own] == k:
            latest[pieces[own]] = own
            own += 1
        used = _place_hits(loose, begins[k], begins[k + 1], every, poses[k], raster, placed, keys)
        for j in range(np.uint64(used)):
            place = _place_of(known.cells, keys[j])
            if known.cells[place, 0] == _NOBODY:
                continue
            x, y, cell = placed[0, j], placed[1, j], np.uint64(known.cells[place, 1])
            met, piece = 0, -1
            for m in range(np.uint64(firsts[cell]), np.uint64(firsts[cell + np.uint64(1)])):
                is_on = _is_on(lines, members[m], poses[k, 0] + x, poses[k, 1] + y, x, y, reach)
                met, piece = (met + 1 if is_on else met), (members[m] if is_on else piece)
            if met != 1:
                continue
            o = latest[np.uint64(piece)]
            if o < 0 or observers[np.uint64(o)] != k:
                latest[piece] = o = count
                observers[o], pieces[o] = k, piece
                for m in range(6):
                    moments[o, m] = 0.0
                count += 1
            _add_hit(moments, o, x, y)
    return Sightings(count, pieces_met, moments, observers, pieces)


@kernel
def sort_sightings(seen: Sightings, numbers: IntArray, count: int) -> tuple[FloatArray, IntArray, IntArray]:
    """Return moments (O, 6) and observers (O,) of sightings, sorted by piece, and the first index (L + 1,) of each.

    `numbers` are the new numbers of the pieces, L in all; pieces with negative numbers are left out. The first indices
    include the end of the last piece.
    """
    begins = cleared(np.empty(count + 1, dtype=np.int64))
    for o in range(seen.size):
        number = numbers[seen.pieces[o]]
        if number >= 0:
            begins[number + 1] += 1
    places = np.empty(count + 1, dtype=np.int64)
    places[0] = 0
    for number in range(count):
        begins[number + 1] += begins[number]
        places[number + 1] = begins[number + 1]
    moments, observers = np.empty((begins[-1], 6)), np.empty(begins[-1], dtype=np.int64)
    for o in range(seen.size):
        number = numbers[seen.pieces[o]]
        if number >= 0:
            place = places[number]
            for i in range(6):
                moments[place, i] = seen.moments[o, i]
            observers[place] = seen.observers[o]
            places[number] += 1
    return moments, observers, begins


@part
def _most(begins: IntArray) -> int:
    """Return the largest number of hits of a stretch."""
    most = 0
    for k in range(len(begins) - 1):
        most = max(most, begins[k + 1] - begins[k])
    return most


@part
def _place_hits(
    hits: npt.NDArray[np.float32],
    first: int,
    stop: int,
    every: int,
    pose: FloatArray,
    raster: Raster,
    placed: FloatArray,
    keys: IntArray,
) -> int:
    """Write where hits of a stretch lie from its place, along the map's axes, and their cells; return their number.

    No hit waits for another one here: the loop is vectorised, and the cells are known before they are looked up.
    """
    c, s, used = math.cos(pose[2]), math.sin(pose[2]), (stop - first + every - 1) // every
    for j in range(np.uint64(used)):
        i = np.uint64(first) + j * np.uint64(every)
        own_x, own_y = float(hits[i, 0]), float(hits[i, 1])
        x, y = c * own_x - s * own_y, s * own_x + c * own_y
        placed[0, j], placed[1, j] = x, y
        keys[j] = _key_of(pose[0] + x - raster.shift, pose[1] + y - raster.shift, 1.0 / raster.cell)
    return used


@part
def _add_hit(moments: FloatArray, number: int, x: float, y: float) -> None:
    o = np.uint64(number)
    moments[o, 0] += 1.0
    moments[o, 1] += x
    moments[o, 2] += y
    moments[o, 3] += x * x
    moments[o, 4] += x * y
    moments[o, 5] += y * y


@part
def _key_of(x: float, y: float, per_cell: float) -> int:
    """Return the key of the cell of a point relative to the offset of the cells [m]."""
    return (math.floor(y * per_cell) << 32) + math.floor(x * per_cell)


@part
def _sector_of(angle: float, sectors: int) -> int:
    """Return the direction nearest to an angle in [-2 pi, 2 pi]."""
    sector = math.floor(angle * (0.5 / math.pi) * sectors + 0.5)
    sector += sectors if sector < 0 else 0
    return sector - (sectors if sector >= sectors else 0)


@part
def _place_of(cells: IntArray, key: int) -> np.uint64:
    """Return the place of a key in a hash table, or the free one where it belongs."""
    mask = len(cells) - 1
    # Multiplies both halves by constants (M. Teschner et al., 2003) that are small enough to avoid overflow.
    mixed = ((key >> 32) * 73856093) ^ ((key & 0xFFFFFFFF) * 19349663)
    place = np.uint64((mixed ^ (mixed >> 29)) & mask)
    while cells[place, 0] != _NOBODY and cells[place, 0] != key:
        place = (place + np.uint64(1)) & np.uint64(mask)
    return place


@part
def _grown(table: IntArray, numbers: IntArray) -> tuple[IntArray, IntArray]:
    """Return the hash table of cells and the index of pieces with twice the size."""
    larger, more = np.empty((2 * len(table), 2), dtype=np.int64), np.empty(2 * len(numbers), dtype=np.int64)
    larger[...], more[:] = _NOBODY, -1
    for old in range(len(table)):
        if table[old, 0] != _NOBODY:
            place = _place_of(larger, table[old, 0])
            larger[place, 0], larger[place, 1] = table[old, 0], table[old, 1]
    for at in range(len(numbers)):
        more[at] = numbers[at]
    return larger, more


@part
def _is_on(lines: FloatArray, number: int, x: float, y: float, way_x: float, way_y: float, reach: float) -> bool:
    """Return whether the end x, y of a beam lies near a line, within its length, and the line faces the laser."""
    px, py, lx, ly, half = lines[number, 0], lines[number, 1], lines[number, 2], lines[number, 3], lines[number, 4]
    across, along = lx * (y - py) - ly * (x - px), lx * (x - px) + ly * (y - py)
    facing, length = ly * way_x - lx * way_y, way_x * way_x + way_y * way_y
    # Without a branch, which would often be mispredicted.
    is_there = (abs(across) <= reach) & (abs(along) <= half)
    return bool(is_there & (facing > 0.0) & (facing * facing > 4e-4 * length))
