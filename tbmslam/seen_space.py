"""Where the last scans saw empty space: what stands there now has walked in, and is no place to hold on to.

People around a robot are on its last scans, a step from where they are now, and a scan laid onto these says that the
robot moves less than it does. What walks into the space that a scan has seen through is known by that.

D. Haehnel, R. Triebel, W. Burgard, S. Thrun, "Map building with mobile robots in dynamic environments", ICRA 2003,
filter such readings before they enter a map.
"""

from collections import deque

import numpy as np

from tbmslam.kernels.seen_space import seen_distances, stands_in_seen_space
from tbmslam.laser_scan import Hits
from tbmslam.se2 import SE2, FloatArray

_DIRECTIONS = 360


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
        self._last: deque[tuple[SE2, FloatArray]] = deque(maxlen=scans)
        self._depth = depth

    def still(self, hits: Hits, T_map_sensor: SE2) -> Hits:
        """Return the hits that do not stand in seen space, and remember what all of them let see."""
        kept = hits
        if self._last:
            lasers = np.array([pose for pose, _ in self._last])
            seen = np.array([distances for _, distances in self._last])
            stays = ~stands_in_seen_space(hits.points, T_map_sensor, lasers, seen, self._depth)
            kept = hits if stays.all() else Hits(hits.points[stays], hits.normals[stays])
        self._last.append((T_map_sensor, seen_distances(hits.points, _DIRECTIONS)))
        return kept
