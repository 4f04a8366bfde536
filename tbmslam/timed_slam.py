"""A SLAM that measures the time of its tracker, for benchmarks; the plain SLAM has no overhead.

Wall time is measured, since reading the CPU time costs a microsecond, which is much beside a scan: to get the CPU time
of both parts, measure that of a whole stretch, and share it out.
"""

import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.slam import Slam
from tbmslam.tracking.tracker import PosePrior, ScanMatch, Tracker

_P = ParamSpec("_P")
_R = TypeVar("_R")


class TimedSlam(Slam):
    """A `Slam` that measures time.

    Attributes
    ----------
    seconds
        Wall time of `matching`, and of `inserting`, which is the update of the tracker by a scan [s].
    """

    def __init__(self, config: SlamConfig) -> None:
        self.seconds = {"matching": 0.0, "inserting": 0.0}
        super().__init__(config)

    def _make_tracker(self) -> Tracker:
        return _TimedTracker(super()._make_tracker(), self.seconds)


class _TimedTracker:
    """A tracker that adds up the wall time of its parts."""

    def __init__(self, tracker: Tracker, seconds: dict[str, float]) -> None:
        self._tracker, self._seconds = tracker, seconds
        self.grid = tracker.grid
        self.is_novel = tracker.is_novel

    def match(self, scan: LaserScan, prior: PosePrior, T_robot_sensor: SE2) -> ScanMatch:
        return self._timed("matching", self._tracker.match, scan, prior, T_robot_sensor)

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        self._timed("inserting", self._tracker.learn, scan, match)

    def _timed(self, part: str, call: Callable[_P, _R], *args: _P.args, **keywords: _P.kwargs) -> _R:
        began = time.perf_counter()
        result = call(*args, **keywords)
        self._seconds[part] += time.perf_counter() - began
        return result
