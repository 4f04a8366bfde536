"""Distances between places of a drive: straight, and along a graph."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, IntArray, kernel
from tbmslam.kernels.arrays import cleared


@kernel
def nearest_stretches(
    poses: FloatArray, place: int, firsts: IntArray, lasts: IntArray, limit: float, longest: float
) -> tuple[IntArray, FloatArray]:
    """Return the stretches within a limit of pose number `place` of (N, >= 2), nearest first, and their distances.

    A stretch contains the poses from its first to its last, and is at most `longest` long.
    """
    near, distances = np.empty(len(firsts), dtype=np.int64), np.empty(len(firsts))
    count = 0
    beyond = (limit + longest) * (limit + longest)
    for number in range(len(firsts)):
        middle = (firsts[number] + lasts[number]) // 2
        dx, dy = poses[middle, 0] - poses[place, 0], poses[middle, 1] - poses[place, 1]
        if dx * dx + dy * dy > beyond:
            continue
        nearest = math.inf
        for k in range(firsts[number], lasts[number] + 1):
            dx, dy = poses[k, 0] - poses[place, 0], poses[k, 1] - poses[place, 1]
            nearest = min(nearest, dx * dx + dy * dy)
        if nearest > limit * limit:
            continue
        slot = count
        while slot > 0 and distances[slot - 1] > nearest:
            near[slot], distances[slot] = near[slot - 1], distances[slot - 1]
            slot -= 1
        near[slot], distances[slot] = number, nearest
        count += 1
    return near[:count], np.sqrt(distances[:count])


@kernel
def shortest_paths(places: int, edges: IntArray, lengths: FloatArray, start: int) -> FloatArray:
    """Return the length (P,) of the shortest path from one place to each place, over edges (E, 2) with lengths (E,).

    Bellman and Ford's algorithm, with the edges in both orders. It converges quickly for edges sorted by place.
    """
    distances = np.empty(places)
    distances[:] = np.inf
    distances[start] = 0.0
    shorter = True
    while shorter:
        shorter = False
        for turn in range(2 * len(edges)):
            e = turn if turn < len(edges) else 2 * len(edges) - 1 - turn
            one, other = edges[e, 0], edges[e, 1]
            if distances[one] + lengths[e] < distances[other]:
                distances[other], shorter = distances[one] + lengths[e], True
            elif distances[other] + lengths[e] < distances[one]:
                distances[one], shorter = distances[other] + lengths[e], True
    return distances


@kernel
def revisited(poses: FloatArray, first: int, reach: float, turn: float, enough: int) -> npt.NDArray[np.bool_]:
    """Return which poses (N, 3) have at least `enough` earlier poses within a distance and a turn.

    The earlier poses are those before `first`, and later ones without enough earlier poses of their own.
    """
    # The poses are sorted by cells whose side is the distance. The neighbours lie in three runs, one for each row.
    cols, rows = np.floor(poses[:, 0] / reach), np.floor(poses[:, 1] / reach)
    stride = cols.max() - cols.min() + 3.0
    cells = rows * stride + cols
    order = np.argsort(cells, kind="mergesort")
    in_order = cells[order]
    shown = cleared(np.empty(len(poses), dtype=np.bool_))
    for k in range(first, len(poses)):
        count = 0
        for row in range(-1, 2):
            middle = cells[k] + row * stride
            stop = np.searchsorted(in_order, middle + 1.5)
            for at in range(np.searchsorted(in_order, middle - 1.5), stop):
                earlier = order[at]
                dx, dy = poses[earlier, 0] - poses[k, 0], poses[earlier, 1] - poses[k, 1]
                turned = abs((poses[earlier, 2] - poses[k, 2] + math.pi) % (2.0 * math.pi) - math.pi)
                if earlier < k and not shown[earlier] and dx * dx + dy * dy <= reach * reach and turned <= turn:
                    count += 1
        shown[k] = count >= enough
    return shown
