"""Counts of the scans that hit each cell, and of the scans that passed it.

Each scan counts once in a cell, so the evidence depends on these two counts only. The counts of a cell are packed into
one integer to save memory: the lowest bits count the scans that passed it, the next bits the scans that hit it, and the
highest bits are the number of the last scan that touched it.
"""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import BoolArray, FloatArray, IntArray, kernel, part
from tbmslam.kernels.arrays import cleared
from tbmslam.kernels.rays.lattice import Lattice

Counts = npt.NDArray[np.int64]

BITS = 21
"""Number of bits of each of the three parts."""
MOST_SCANS = (1 << BITS) - 1
"""Largest number of scans."""
LOW = MOST_SCANS
ONE_HIT = 1 << BITS
BOTH = (1 << (2 * BITS)) - 1

FRACTION_BITS = 40
FRACTION = float(1 << FRACTION_BITS)
"""Fixed-point unit of a cell: beams are followed in integers, which need no conversion at each step."""

COVERED = 0.8
"""Distance between neighbouring beams that together touch every cell between them [cells]."""


@part
def hits_in(count: int) -> int:
    """Return the number of scans that hit a cell."""
    return (count >> BITS) & LOW


@part
def passages_in(count: int) -> int:
    """Return the number of scans that passed a cell."""
    return count & LOW


@kernel
def beam_ends(
    ranges: npt.NDArray[np.float32],
    offsets: IntArray,
    beams: FloatArray,
    beam_steps: FloatArray,
    poses: FloatArray,
    max_range: float,
    clears: bool,
) -> tuple[FloatArray, npt.NDArray[np.bool_], IntArray]:
    """Return the end points of the beams of many scans [m], whether each is a hit, and the first index of each scan.

    Parameters
    ----------
    ranges, offsets, beams, beam_steps
        As in `tbmslam.map.keyframes.Keyframes`.
    poses
        Poses (K, 3) of the laser.
    max_range
        Hits beyond this range only clear the space up to it [m].
    clears
        Whether beams without a return clear the space up to their limit; otherwise they are ignored.
    """
    ends = np.empty((len(ranges), 2))
    is_hit = cleared(np.empty(len(ranges), dtype=np.bool_))
    starts = cleared(np.empty(len(offsets), dtype=np.int64))
    count = 0
    for k in range(len(poses)):
        limit = min(max_range, beams[k, 3])
        # The position of the laser and the direction advance from beam to beam, as in `hit_points`.
        x, y = poses[k, 0], poses[k, 1]
        cosine, sine = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        step_x = cosine * beam_steps[k, 0] - sine * beam_steps[k, 1]
        step_y = sine * beam_steps[k, 0] + cosine * beam_steps[k, 1]
        sway_cosine, sway_sine = math.cos(beam_steps[k, 2]), math.sin(beam_steps[k, 2])
        cosine, sine = math.cos(poses[k, 2] + beams[k, 0]), math.sin(poses[k, 2] + beams[k, 0])
        turn = beams[k, 1] + beam_steps[k, 2]
        turn_cosine, turn_sine = math.cos(turn), math.sin(turn)
        for i in range(offsets[k], offsets[k + 1]):
            length = float(ranges[i])
            if not (math.isnan(length) or (length == math.inf and not clears)):
                is_hit[count] = length <= max_range and length != math.inf
                if not is_hit[count]:
                    length = min(length, limit)
                ends[count, 0], ends[count, 1] = x + length * cosine, y + length * sine
                count += 1
            cosine, sine = cosine * turn_cosine - sine * turn_sine, sine * turn_cosine + cosine * turn_sine
            x, y = x + step_x, y + step_y
            step_x, step_y = step_x * sway_cosine - step_y * sway_sine, step_y * sway_cosine + step_x * sway_sine
        starts[k + 1] = count
    return ends[:count], is_hit[:count], starts


@kernel
def count_scans(
    counts: Counts,
    lattice: Lattice,
    lasers: FloatArray,
    ends: FloatArray,
    is_hit: npt.NDArray[np.bool_],
    offsets: IntArray,
    before: int,
) -> None:
    """Count each scan once in every cell that it touches: as a hit if one of its beams hit the cell, else as a passage.

    `counts` (rows, cols) must contain all beams and a margin of one cell. `lasers` (K, >= 2) are the positions of the
    laser [m], `ends` (N, 2) the end points of the beams in the order of their angles [m], and `is_hit` (N,) states
    which are hits. `offsets` (K + 1,) are the first index of each scan in `ends`, and the end of the last scan.
    `before` scans were counted before; scans have numbers from 1 to `MOST_SCANS`.
    """
    resolution, first_row, first_col = lattice
    width = counts.shape[1]
    cells = counts.reshape(-1)
    most = 0
    for k in range(len(lasers)):
        most = max(most, offsets[k + 1] - offsets[k])
    beams, paths = np.empty((6, most)), np.empty((8, most), dtype=np.int64)
    for k in range(len(lasers)):
        spoken, first = (before + k + 1) << (2 * BITS), offsets[k]
        number = offsets[k + 1] - first
        _measure_beams(lasers[k], ends, first, number, resolution, beams)
        for i in range(number):
            row, col = math.floor(beams[4, i]) - first_row, math.floor(beams[3, i]) - first_col
            cell = np.uint64(row * width + col)
            known = cells[cell]
            cells[cell] = (known & BOTH | spoken) + ONE_HIT if is_hit[first + i] and known < spoken else known
        x, y = lasers[k, 0] / resolution - first_col, lasers[k, 1] / resolution - first_row
        _plan_paths(beams, number, (x, y), (first_row, first_col), width, paths)
        _count_paths(cells, spoken, paths, number)


@part
def _measure_beams(
    laser: FloatArray, ends: FloatArray, first: int, number: int, resolution: float, beams: FloatArray
) -> None:
    """Write what a scan's beams are, in rows (6, beams) so that the loop is vectorised.

    The rows are x, y and the length of the beam [m], x and y of its end [cells], and the share of its length that
    other beams count, see `_seen_by_neighbours`.
    """
    x, y = laser[0], laser[1]
    for i in range(number):
        end_x, end_y = ends[first + i, 0], ends[first + i, 1]
        dx, dy = end_x - x, end_y - y
        beams[0, i], beams[1, i], beams[2, i] = dx, dy, math.sqrt(dx * dx + dy * dy)
        beams[3, i], beams[4, i] = end_x / resolution, end_y / resolution
    for i in range(number):
        beams[5, i] = _seen_by_neighbours(beams, number, i, resolution)


@part
def _seen_by_neighbours(beams: FloatArray, count: int, number: int, resolution: float) -> float:
    """Return the share of a beam's length, from the laser, in which two other beams touch all of its cells.

    Beams are dense near the laser. There the beams with odd numbers are skipped, nearer still every second beam of the
    rest, and so on. The two other beams therefore are as far away as the largest power of two that divides the number.
    """
    apart = number & -number
    if number == 0 or number + apart >= count:
        return 0.0
    ax, ay, a = beams[0, number - apart], beams[1, number - apart], beams[2, number - apart]
    bx, by, b = beams[0, number + apart], beams[1, number + apart], beams[2, number + apart]
    length = beams[2, number]
    if ax * bx + ay * by <= 0.0 or length == 0.0:
        return 0.0
    parted = COVERED * resolution * a * b / max(abs(ax * by - ay * bx), 1e-12)
    return float(min(parted, a, b) / length)


@part
def _plan_paths(
    beams: FloatArray,
    number: int,
    laser: tuple[float, float],
    corner: tuple[int, int],
    width: int,
    paths: IntArray,
) -> None:
    """Write the path of each beam through the cells (8, beams), from where its neighbours no longer see them.

    A path is a 4-connected line. It goes along the longer axis of the beam, and takes the cells where the beam enters
    and leaves each row or column. Its numbers are: the steps along the axis, -1 if nothing is left to count; the step
    to the next cell along the axis and across it; the first cell's part along the axis; the first cell; where the beam
    leaves the first row or column, across the axis, and how far it goes across in a step, in parts of a cell; the last
    cell. Cells are places in the array. The numbers are written before any cell is counted: the loop has no branch, so
    it is vectorised, and the processor knows the number of steps early.
    """
    x, y = laser
    first_row, first_col = corner
    for i in range(np.uint64(number)):
        seen, dx, dy = beams[5, i], beams[3, i] - first_col - x, beams[4, i] - first_row - y
        start_x, start_y, end_x, end_y = x + seen * dx, y + seen * dy, x + dx, y + dy
        dx, dy = end_x - start_x, end_y - start_y
        is_flat = abs(dx) >= abs(dy)
        far, wide = (dx if is_flat else dy), (dy if is_flat else dx)
        begin, beside = (start_x if is_flat else start_y), (start_y if is_flat else start_x)
        along, across = math.floor(begin), math.floor(beside)
        last_along = math.floor(end_x if is_flat else end_y)
        last_across = math.floor(end_y if is_flat else end_x)
        step, side = (1 if is_flat else width), (width if is_flat else 1)
        steps = abs(last_along - along)
        slope = wide / abs(far) if steps > 0 else 0.0
        leaves = beside + (along + 1 - begin if far > 0.0 else begin - along) * slope
        paths[0, i] = steps if seen < 1.0 else -1
        paths[1, i], paths[2, i] = (step if far > 0.0 else -step), side
        paths[3, i], paths[4, i] = along * step, along * step + across * side
        paths[5, i], paths[6, i] = int(leaves * FRACTION), int(slope * FRACTION)
        paths[7, i] = last_along * step + last_across * side


@part
def _count_paths(cells: npt.NDArray[np.int64], spoken: int, paths: IntArray, number: int) -> None:
    """Count a passage of the cells of each path, see `_plan_paths`."""
    for i in range(np.uint64(number)):
        step, side, along, entered = paths[1, i], paths[2, i], paths[3, i], paths[4, i]
        way, climb = paths[5, i], paths[6, i]
        for _ in range(paths[0, i]):
            left = along + (way >> FRACTION_BITS) * side
            _count_pair(cells, entered, left, spoken)
            way += climb
            along += step
            entered = left + step
        if paths[0, i] >= 0:
            _count_pair(cells, entered, paths[7, i], spoken)


@part
def _count_pair(cells: npt.NDArray[np.int64], one: int, other: int, spoken: int) -> None:
    """Count a passage of two cells, which may be the same.

    Scan numbers rise, so cells that this scan touched already are not below `spoken`. Both cells are read before one is
    written, without a branch, so that the processor does not wait.
    """
    first, second = cells[np.uint64(one)], cells[np.uint64(other)]
    cells[np.uint64(one)] = first if first >= spoken else (first & BOTH) + (spoken + 1)
    cells[np.uint64(other)] = second if second >= spoken else (second & BOTH) + (spoken + 1)


@part
def write_masses(
    counts: Counts,
    first_row: int,
    first_col: int,
    hit_decay: FloatArray,
    miss_decay: FloatArray,
    keeps_conflict: bool,
    masses: npt.NDArray[np.float32],
) -> None:
    """Write the masses (rows, cols, 4) of a window of the counts: conflict, free, occupied, unknown.

    The window begins at `first_row` and `first_col`. Cells beyond the counts are vacuous.
    `hit_decay` (H, 2) and `miss_decay` (M, 2) are powers of q(UNKNOWN) / q(FREE) and q(UNKNOWN) / q(OCCUPIED) of one
    hit and of one passage, for every exponent from 0 to the largest count; see `tbmslam.belief.evidence_grid`. With
    `keeps_conflict` evidence is combined conjunctively (eq. 5), else by Dempster's rule.
    """
    for row in range(masses.shape[0]):
        for col in range(masses.shape[1]):
            hits, passed = 0, 0
            if first_row + row < counts.shape[0] and first_col + col < counts.shape[1]:
                count = counts[first_row + row, first_col + col]
                hits, passed = hits_in(count), passages_in(count)
            if hits + passed == 0:  # most of a map
                masses[row, col, 0], masses[row, col, 1] = 0.0, 0.0
                masses[row, col, 2], masses[row, col, 3] = 0.0, 1.0
                continue
            not_free = hit_decay[hits, 0] * miss_decay[passed, 0]
            not_occupied = hit_decay[hits, 1] * miss_decay[passed, 1]
            unknown = not_free * not_occupied
            free, occupied = (1.0 - not_free) * not_occupied, (1.0 - not_occupied) * not_free
            conflict = (1.0 - not_free) * (1.0 - not_occupied)
            if not keeps_conflict:
                total = unknown + free + occupied
                conflict, free, occupied, unknown = 0.0, free / total, occupied / total, unknown / total
            masses[row, col, 0], masses[row, col, 1] = conflict, free
            masses[row, col, 2], masses[row, col, 3] = occupied, unknown


@kernel
def counted_tiles(counts: Counts, side: int, found: BoolArray) -> None:
    """Mark which square tiles (R, C) of ``side`` cells hold a counted cell."""
    rows, cols = counts.shape
    for row in range(rows):
        for tile in range(found.shape[1]):
            if not found[row // side, tile]:
                for col in range(tile * side, min((tile + 1) * side, cols)):
                    if counts[row, col] != 0:
                        found[row // side, tile] = True
                        break


@kernel
def write_tiles(
    counts: Counts,
    places: IntArray,
    hit_decay: FloatArray,
    miss_decay: FloatArray,
    keeps_conflict: bool,
    tiles: npt.NDArray[np.float32],
) -> None:
    """Write the masses of some tiles (N, side, side, 4), as `write_masses`.

    ``places`` (N, 2) are the rows and columns of the tiles.
    """
    side = tiles.shape[1]
    for number in range(len(places)):
        row, col = places[number, 0] * side, places[number, 1] * side
        write_masses(counts, row, col, hit_decay, miss_decay, keeps_conflict, tiles[number])
