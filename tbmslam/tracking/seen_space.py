"""Where the last scans saw empty space: what stands there now has walked in, and is no place to hold on to.

People around a robot are on its last scans, a step from where they are now, and a scan laid onto these says that the
robot moves less than it does. What walks into the space that a scan has seen through is known by that.

D. Haehnel, R. Triebel, W. Burgard, S. Thrun, "Map building with mobile robots in dynamic environments", ICRA 2003,
filter such readings before they enter a map.
"""

import numpy as np
import numpy.typing as npt

from tbmslam.kernels.seen_space import seen_distances, stands_in_seen_space, still_hits
from tbmslam.laser_scan import Hits
from tbmslam.se2 import SE2, FloatArray

_DIRECTIONS = 360
_LARGEST_WALKER = 1.0  # [m]
_APART = 0.5  # neighbouring hits farther from each other are on two things [m]
_NEAR_BESIDE = 0.3  # people who pass by a wall are as near to it [m]


class SeenSpace:
    """Remembers how far the last scans saw.

    Parameters
    ----------
    scans
        How many of them.
    depth
        How far a scan must have gone on behind a point to have seen through its place [m].
    """

    def __init__(self, scans: int, depth: float) -> None:
        # A ring: the oldest one is written over.
        self._lasers, self._seen = np.zeros((scans, 3)), np.zeros((scans, _DIRECTIONS))
        self._number = 0
        self._known: tuple[Hits, SE2, Hits] | None = None
        self._depth = depth

    def still(self, hits: Hits, T_map_sensor: SE2) -> Hits:
        """Return the hits that do not stand in seen space, and remember what all of them let see."""
        kept = self.standing(hits, T_map_sensor)
        if len(self._lasers):
            place = self._number % len(self._lasers)
            self._lasers[place], self._seen[place] = T_map_sensor, seen_distances(hits.points, _DIRECTIONS)
            self._number += 1
            self._known = None
        return kept

    def in_seen_space(self, hits: Hits, T_map_sensor: SE2) -> npt.NDArray[np.bool_]:
        """Return which hits (M,) stand in seen space."""
        number = min(self._number, len(self._lasers))
        return stands_in_seen_space(hits.points, T_map_sensor, self._lasers[:number], self._seen[:number], self._depth)

    def standing(self, hits: Hits, T_map_sensor: SE2) -> Hits:
        """Return the hits that do not stand in seen space; asked again for the same at once, it knows the answer."""
        if self._known is not None and self._known[0] is hits and self._known[1] == T_map_sensor:
            return self._known[2]
        standing, number = hits, min(self._number, len(self._lasers))
        if number:
            lasers, seen = self._lasers[:number], self._seen[:number]
            standing = Hits(*still_hits(hits.points, hits.normals, T_map_sensor, lasers, seen, self._depth))
        self._known = hits, T_map_sensor, standing
        return standing


def may_walk(points: FloatArray) -> bool:
    """Tell whether neighbouring hits (M, 2) are on things as small as people [m]; walls are not."""
    if not len(points):
        return False
    cuts = np.flatnonzero(np.hypot(*np.diff(points, axis=0).T) > _APART) + 1
    return all(np.hypot(*np.ptp(thing, axis=0)) <= _LARGEST_WALKER for thing in np.split(points, cuts))


def small_things(points: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which hits (M, 2), neighbours, are on things as small as people that stand before what is beside them."""
    cuts = np.flatnonzero(np.hypot(*np.diff(points, axis=0).T) > _NEAR_BESIDE) + 1
    begins, ends = np.concatenate(([0], cuts)), np.concatenate((cuts, [len(points)]))
    ranges = np.hypot(points[:, 0], points[:, 1])
    are = np.zeros(len(points), dtype=np.bool_)
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        is_before = begin == 0 or ranges[begin - 1] > ranges[begin]
        is_behind = end < len(points) and ranges[end] < ranges[end - 1]
        if is_before and not is_behind and begin < end:
            are[begin:end] = np.hypot(*np.ptp(points[begin:end], axis=0)) <= _LARGEST_WALKER
    return are
