"""Which stretches of a drive later keyframes are searched in, and which of them a keyframe may see."""

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.search.ways import nearest_stretches
from tbmslam.loop_closure.drift_graph import DriftGraph
from tbmslam.loop_closure.drive_hits import DriveHits
from tbmslam.loop_closure.submap import Submap, SubmapConfig, split_into_submaps
from tbmslam.tracking.surfel_map import SurfelConfig

_SUBMAPS_KEPT = 500


class NearTargets(NamedTuple):
    """Targets near a keyframe, the nearest first.

    Parameters
    ----------
    targets
        Their numbers (T,).
    distances
        How far the keyframe is from their ways (T,) [m].
    """

    targets: npt.NDArray[np.int64]
    distances: FloatArray


class ClosingTargets:
    """Stretches of a drive that were new when the robot came through.

    A stretch becomes a target some way after its end, unless it was itself laid onto older ones: what comes back to it
    finds those as well. So a robot that goes round and round has targets on its first round only, and neither their
    number nor what a search costs grows with the rounds. (Cartographer trims submaps by what they cover instead.)

    Parameters
    ----------
    hits
        What the drive's keyframes hit.
    config
        How submaps are made.
    surfels
        What makes a surface.
    min_gap
        Travelled length after which a stretch may be met again [m].
    familiar
        Share of a stretch's keyframes searched for, from which on it counts as laid onto older ones.

    Attributes
    ----------
    length
        Travelled length of a target [m].
    last_met
        Travelled length at which a keyframe was last laid onto a target [m].
    """

    def __init__(
        self, hits: DriveHits, config: SubmapConfig, surfels: SurfelConfig, min_gap: float, familiar: float
    ) -> None:
        self._hits, self._config, self._surfels = hits, config, surfels
        self._min_gap, self._familiar = min_gap, familiar
        self._stretches = np.array(split_into_submaps(hits.poses, config.length))
        self._decided = 0
        # Of the targets, in the order of the drive: first and last keyframe.
        self._firsts, self._lasts = np.zeros((2, len(self._stretches)), dtype=np.int64)
        self._ends: list[float] = []  # where on the way they end [m]
        self._graph = DriftGraph()
        self._latest = np.zeros(len(self._stretches), dtype=np.int64)  # keyframes that were laid onto them last
        self.length = config.length
        self.last_met = 0.0
        self._searched, self._laid = np.zeros((2, len(hits.poses)), dtype=np.bool_)
        self._submaps: dict[int, Submap] = {}

    def advance(self, keyframe: int) -> None:
        """Let the drive have come to a keyframe: new stretches far enough behind it become targets."""
        travelled = self._hits.travelled
        while self._decided < len(self._stretches):
            first, last = self._stretches[self._decided].tolist()
            if travelled[last] >= travelled[keyframe] - self._min_gap:
                break
            self._decided += 1
            laid, searched = self._laid[first : last + 1].sum(), self._searched[first : last + 1].sum()
            if laid == 0 or laid < self._familiar * searched:
                self._firsts[len(self._ends)], self._lasts[len(self._ends)] = first, last
                self._latest[len(self._ends)] = (first + last) // 2
                self._ends.append(float(travelled[last]))
                self._graph.add_place(float(travelled[(first + last) // 2]))

    def note(self, keyframe: int, targets: Sequence[int]) -> None:
        """Note which targets a keyframe that was searched for was laid onto; keyframes come in the drive's order."""
        self._searched[keyframe], self._laid[keyframe] = True, bool(targets)
        for target in targets:
            self._latest[target], self.last_met = keyframe, float(self._hits.travelled[keyframe])
            self._graph.meet(target, self.last_met)

    def near(self, keyframe: int, poses: FloatArray, limit: float) -> NearTargets:
        """Return the targets of earlier visits whose ways, by the poses (K, 3), are within a limit [m]."""
        travelled = self._hits.travelled
        old = bisect_left(self._ends, travelled[keyframe] - self._min_gap)
        firsts, lasts = self._firsts[:old], self._lasts[:old]
        return NearTargets(*nearest_stretches(poses, keyframe, firsts, lasts, limit, self._config.length))

    def ways(self, keyframe: int) -> FloatArray:
        """Return the shortest way (T,), over all that was laid onto targets, from a keyframe to each of them [m]."""
        return self._graph.ways_from(float(self._hits.travelled[keyframe]))

    def anchors(self, keyframe: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return the middle keyframes (T,) of targets of earlier visits, and those (T,) that were last laid onto them.

        Where none was laid, that is the middle one.
        """
        old = bisect_left(self._ends, self._hits.travelled[keyframe] - self._min_gap)
        return (self._firsts[:old] + self._lasts[:old]) // 2, self._latest[:old]

    def stretch(self, target: int) -> tuple[int, int]:
        """Return the first and the last keyframe of a target."""
        return int(self._firsts[target]), int(self._lasts[target])

    def submap(self, target: int) -> Submap:
        """Return a target as a submap; those used last are kept, however long the drive is."""
        submap = self._submaps.pop(target, None)
        if submap is None:
            first, last = int(self._firsts[target]), int(self._lasts[target])
            submap = Submap(first, last, self._hits, self._config, self._surfels)
        self._submaps[target] = submap
        if len(self._submaps) > _SUBMAPS_KEPT:
            del self._submaps[next(iter(self._submaps))]
        return submap
