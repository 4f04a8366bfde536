"""How far the robot may have drifted since it was at places of its drive: the length of the shortest way to them."""

from bisect import bisect

import numpy as np

from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.search.ways import shortest_ways

_BRIDGE = 0.5
"""What laying the robot onto a place adds to the way [m]."""


class DriftGraph:
    """Places joined by the stretches driven between them, the shortest of each pair of places only.

    It therefore grows with what was explored and not with the drive. A place is passed once, and met again whenever
    the robot is laid onto it.
    """

    def __init__(self) -> None:
        self._places = 0
        self._edges: dict[tuple[int, int], int] = {}
        self._ends = np.zeros((64, 2), dtype=np.int64)
        self._lengths = np.zeros(64)
        # (travelled, place, what it adds) from the place passed last on, in the order of the drive.
        self._meetings: list[tuple[float, int, float]] = []

    def add_place(self, travelled: float) -> int:
        """Add the place that was passed after some way [m], further along than those before; return its number."""
        place, at = self._places, bisect(self._meetings, (travelled, -1, 0.0))
        self._places += 1
        for neighbour in self._meetings[max(at - 1, 0) : at + 1]:
            self._join((travelled, place, 0.0), neighbour)
        self._meetings.insert(at, (travelled, place, 0.0))
        del self._meetings[:at]
        return place

    def meet(self, place: int, travelled: float) -> None:
        """Note that the robot was laid onto a place after some way [m], further along than those before."""
        if self._meetings:
            self._join((travelled, place, _BRIDGE), self._meetings[-1])
        self._meetings.append((travelled, place, _BRIDGE))

    def ways_from(self, travelled: float) -> FloatArray:
        """Return the shortest way (P,) to every place from where the robot is after some way [m]."""
        since, place, bridge = self._meetings[-1]
        used = len(self._edges)
        return shortest_ways(self._places, self._ends[:used], self._lengths[:used], place) + travelled - since + bridge

    def _join(self, one: tuple[float, int, float], other: tuple[float, int, float]) -> None:
        """Let a way lead from one place to another."""
        if one[1] == other[1]:
            return
        ends, length = (min(one[1], other[1]), max(one[1], other[1])), abs(one[0] - other[0]) + one[2] + other[2]
        slot = self._edges.setdefault(ends, len(self._edges))
        if slot == len(self._lengths):
            self._ends = np.concatenate((self._ends, np.zeros_like(self._ends)))
            self._lengths = np.concatenate((self._lengths, np.zeros_like(self._lengths)))
        if self._lengths[slot] == 0.0 or length < self._lengths[slot]:
            self._ends[slot], self._lengths[slot] = ends, length
