"""The surfels of the last metres of a drive, on which its scans are registered."""

import math

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import Hits
from tbmslam.tracking.surfel_map import SurfelConfig, SurfelMap


class LocalSurfels:
    """A surfel map that reaches back one to two times a travelled length `window` [m].

    Surfels cannot be removed. So a map of the later part replaces the map once that part is long enough.
    """

    def __init__(self, config: SurfelConfig, window: float) -> None:
        self._config, self._window = config, window
        self.map = SurfelMap(config)
        self._recent: list[tuple[Hits, SE2]] = []
        self._travelled = 0.0
        self._last: SE2 | None = None

    def insert(self, hits: Hits, pose: SE2) -> None:
        """Add the hits of a scan at its pose, and drop old surfels."""
        if self._last is not None:
            self._travelled += math.hypot(pose.x - self._last.x, pose.y - self._last.y)
        self._last = pose
        if self._travelled > self._window:
            # The new map will be as large as the old map.
            self.map = SurfelMap(self._config, slots=self.map.slots)
            for recent in self._recent:
                self.map.insert(*recent)
            self._recent.clear()
            self._travelled = 0.0
        self.map.insert(hits, pose)
        self._recent.append((hits, pose))
