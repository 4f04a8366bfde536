"""How far apart places of a drive are: straight, and along the way."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@kernel
def distances_to_stretches(poses: FloatArray, place: int, firsts: IntArray, lasts: IntArray) -> FloatArray:
    """Return how far one pose of (N, >= 2) is from the nearest one of each stretch (S,), first and last included."""
    distances = np.empty(len(firsts))
    for number in range(len(firsts)):
        nearest = math.inf
        for k in range(firsts[number], lasts[number] + 1):
            dx, dy = poses[k, 0] - poses[place, 0], poses[k, 1] - poses[place, 1]
            nearest = min(nearest, dx * dx + dy * dy)
        distances[number] = math.sqrt(nearest)
    return distances


@kernel
def shortest_ways(travelled: FloatArray, bridges: IntArray, bridge_length: float, start: int) -> FloatArray:
    """Return the length of the shortest way from a place of a drive to all others (N,), over bridges too.

    `travelled` (N,) rises along the drive; `bridges` (B, 2) join places. Sweeps along the drive, forth and back, until
    no bridge shortens anything (Bellman and Ford).
    """
    ways = np.full(len(travelled), np.inf)
    ways[start] = 0.0
    shorter = True
    while shorter:
        for k in range(1, len(ways)):
            ways[k] = min(ways[k], ways[k - 1] + travelled[k] - travelled[k - 1])
        for k in range(len(ways) - 1, 0, -1):
            ways[k - 1] = min(ways[k - 1], ways[k] + travelled[k] - travelled[k - 1])
        shorter = False
        for b in range(len(bridges)):
            one, other = bridges[b, 0], bridges[b, 1]
            if ways[one] + bridge_length < ways[other]:
                ways[other], shorter = ways[one] + bridge_length, True
            elif ways[other] + bridge_length < ways[one]:
                ways[one], shorter = ways[other] + bridge_length, True
    return ways
