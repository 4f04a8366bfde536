"""Submaps as targets of loop closure, and the choice of possible targets by the drift."""

import math
from bisect import bisect, bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import FloatArray, IntArray, adjoints, inverse
from tbmslam.kernels.search.path_lengths import nearest_stretches, shortest_paths
from tbmslam.loop_closure.submap import Submap, SubmapConfig, split_into_submaps
from tbmslam.map.scan_hits import DriveHits
from tbmslam.tracking.surfel_map import SurfelConfig

_BRIDGE = 0.5
"""Length that a registration to a place adds to a path [m]."""


class DriftGraph:
    """A graph of places; an edge is the shortest path driven between two of them.

    It grows with the explored area and not with the drive. A place is added once; each registration to it adds edges.
    """

    def __init__(self) -> None:
        self._places = 0
        self._edges: dict[tuple[int, int], int] = {}
        self._ends = np.zeros((64, 2), dtype=np.int64)
        self._lengths = np.zeros(64)
        # (travelled, place, added length) since the last passed place, in the order of the drive.
        self._meetings: list[tuple[float, int, float]] = []

    def add_place(self, travelled: float) -> int:
        """Add the place that was passed after a path [m], longer than all before; return its number."""
        place, at = self._places, bisect(self._meetings, (travelled, -1, 0.0))
        self._places += 1
        for neighbour in self._meetings[max(at - 1, 0) : at + 1]:
            self._join((travelled, place, 0.0), neighbour)
        self._meetings.insert(at, (travelled, place, 0.0))
        del self._meetings[:at]
        return place

    def meet(self, place: int, travelled: float) -> None:
        """Note a registration to a place after a path [m], longer than all before."""
        if self._meetings:
            self._join((travelled, place, _BRIDGE), self._meetings[-1])
        self._meetings.append((travelled, place, _BRIDGE))

    def paths_from(self, travelled: float) -> FloatArray:
        """Return the length of the shortest path (P,) to every place from the robot after a path [m]."""
        since, place, bridge = self._meetings[-1]
        used = len(self._edges)
        return shortest_paths(self._places, self._ends[:used], self._lengths[:used], place) + travelled - since + bridge

    def _join(self, one: tuple[float, int, float], other: tuple[float, int, float]) -> None:
        """Join two places, unless a shorter path does."""
        if one[1] == other[1]:
            return
        ends, length = (min(one[1], other[1]), max(one[1], other[1])), abs(one[0] - other[0]) + one[2] + other[2]
        slot = self._edges.setdefault(ends, len(self._edges))
        if slot == len(self._lengths):
            self._ends = np.concatenate((self._ends, np.zeros_like(self._ends)))
            self._lengths = np.concatenate((self._lengths, np.zeros_like(self._lengths)))
        if self._lengths[slot] == 0.0 or length < self._lengths[slot]:
            self._ends[slot], self._lengths[slot] = ends, length


class ChainDrift:
    """Sums of the covariances along a drive, so that the drift between two keyframes is one difference.

    `poses` (K, 3) are the keyframes as tracked, and `covariances` (K - 1, 3, 3) those of the motions in the frame at
    their end.
    """

    def __init__(self, poses: FloatArray, covariances: FloatArray) -> None:
        self._poses = poses
        carried = adjoints(poses[1:]) @ covariances @ np.swapaxes(adjoints(poses[1:]), 1, 2)
        self._sums = np.zeros((len(poses), 3, 3))
        np.cumsum(carried, axis=0, out=self._sums[1:])

    def deviations(self, sources: IntArray, targets: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the deviations of position (N,) [m], along its worst direction, and heading (N,) [rad].

        They describe targets as seen from sources, by the motions between them only (first order; Sola et al., eq. 54).
        """
        sums = self._sums[np.maximum(sources, targets)] - self._sums[np.minimum(sources, targets)]
        to_target = adjoints(inverse(self._poses[targets]))
        covariances = to_target @ sums @ np.swapaxes(to_target, 1, 2)
        xx, yy, xy = covariances[:, 0, 0], covariances[:, 1, 1], covariances[:, 0, 1]
        largest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
        return np.sqrt(np.maximum(largest, 0.0)), np.sqrt(np.maximum(covariances[:, 2, 2], 0.0))

    def largest_deviation(self, first: int, last: int) -> float:
        """Return a bound of the deviation of position between a keyframe and a later one [m], by plain numbers.

        It bounds the deviations from all keyframes in between, too: a covariance grows along a drive.
        """
        (xx, _, xt), (_, yy, yt), (_, _, tt) = (self._sums[last] - self._sums[first]).tolist()
        x, y, _ = self._poses[last].tolist()
        return math.sqrt(max(xx - 2.0 * y * xt + yy + 2.0 * x * yt + (x * x + y * y) * tt, 0.0))


_SUBMAPS_KEPT = 500


class NearTargets(NamedTuple):
    """Targets near a keyframe, the nearest first."""

    targets: IntArray
    """Their numbers (T,)."""
    distances: FloatArray
    """Distances of the keyframe from their paths (T,) [m]."""


class ClosingTargets:
    """Segments of a drive through unexplored places, as targets of loop closure.

    A segment becomes a target after a further length `min_gap` [m], unless a share `familiar` of its searched keyframes
    was registered to older targets. So a robot that repeats a round has targets on its first round only, and the cost
    of a search does not grow with the rounds. (Cartographer trims submaps by the area they cover instead.)

    `length` is the travelled length of a target, and `last_met` that at the last registration to a target [m].
    """

    def __init__(
        self, hits: DriveHits, config: SubmapConfig, surfels: SurfelConfig, min_gap: float, familiar: float
    ) -> None:
        self._hits, self._config, self._surfels = hits, config, surfels
        self._min_gap, self._familiar = min_gap, familiar
        self._stretches = split_into_submaps(hits.travelled, config.length)
        self._travelled: list[float] = hits.travelled.tolist()
        self._decided = 0
        # First and last keyframes of the targets, in the order of the drive.
        self._firsts, self._lasts = np.zeros((2, len(self._stretches)), dtype=np.int64)
        self._ends: list[float] = []  # travelled length at their ends [m]
        self._graph = DriftGraph()
        self._latest = np.zeros(len(self._stretches), dtype=np.int64)  # keyframes that were registered to them last
        self.length = config.length
        self.last_met = 0.0
        self._searched, self._laid = np.zeros((2, len(hits.poses)), dtype=np.bool_)
        self._submaps: dict[int, Submap] = {}

    def advance(self, keyframe: int) -> None:
        """Advance to a keyframe: segments far enough behind it become targets."""
        travelled = self._travelled
        while self._decided < len(self._stretches):
            first, last = self._stretches[self._decided]
            if travelled[last] >= travelled[keyframe] - self._min_gap:
                break
            self._decided += 1
            laid, searched = self._laid[first : last + 1].sum(), self._searched[first : last + 1].sum()
            if laid == 0 or laid < self._familiar * searched:
                self._firsts[len(self._ends)], self._lasts[len(self._ends)] = first, last
                self._latest[len(self._ends)] = (first + last) // 2
                self._ends.append(travelled[last])
                self._graph.add_place(travelled[(first + last) // 2])

    def note(self, keyframe: int, targets: Sequence[int]) -> None:
        """Note the targets to which a searched keyframe was registered; keyframes come in the drive's order."""
        self._searched[keyframe], self._laid[keyframe] = True, bool(targets)
        for target in targets:
            self._latest[target], self.last_met = keyframe, self._travelled[keyframe]
            self._graph.meet(target, self.last_met)

    def near(self, keyframe: int, poses: FloatArray, limit: float) -> NearTargets:
        """Return the targets of earlier visits whose paths, by the poses (K, 3), are within a limit [m]."""
        old = bisect_left(self._ends, self._travelled[keyframe] - self._min_gap)
        firsts, lasts = self._firsts[:old], self._lasts[:old]
        return NearTargets(*nearest_stretches(poses, keyframe, firsts, lasts, limit, self._config.length))

    def path_lengths(self, keyframe: int) -> FloatArray:
        """Return the length of the shortest path (T,) from a keyframe to each target, over all registrations [m]."""
        return self._graph.paths_from(self._travelled[keyframe])

    def anchors(self, keyframe: int) -> tuple[IntArray, IntArray]:
        """Return the middle keyframes (T,) of targets of earlier visits, and those (T,) last registered to them.

        Without a registration it is the middle one.
        """
        old = bisect_left(self._ends, self._travelled[keyframe] - self._min_gap)
        return (self._firsts[:old] + self._lasts[:old]) // 2, self._latest[:old]

    def stretch(self, target: int) -> tuple[int, int]:
        """Return the first and the last keyframe of a target."""
        return int(self._firsts[target]), int(self._lasts[target])

    def submap(self, target: int) -> Submap:
        """Return a target as a submap; the most recent ones are kept."""
        submap = self._submaps.pop(target, None)
        if submap is None:
            submap = Submap(*self.stretch(target), self._hits, self._config, self._surfels)
        self._submaps[target] = submap
        if len(self._submaps) > _SUBMAPS_KEPT:
            del self._submaps[next(iter(self._submaps))]
        return submap
