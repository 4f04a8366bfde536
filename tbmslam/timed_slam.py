"""A SLAM that measures the time of its parts, for benchmarks; the plain SLAM has no overhead.

Wall time is measured, since reading the CPU time costs a microsecond, which is much beside a scan: to get CPU time
of the parts measures that of a whole stretch, and shares it out.
"""

import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from tbmslam.back_end import OptimisedDrive
from tbmslam.belief.grid import TbmGrid
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.slam import Slam
from tbmslam.tracking.tracker import PosePrior, ScanMatch, Tracker

_P = ParamSpec("_P")
_R = TypeVar("_R")

STAGES = ("matching", "inserting", "closing", "rendering")
"""The timed parts; inserting is the update of the tracker by a scan."""


class StageClock:
    """Adds up wall time by stage.

    Attributes
    ----------
    seconds
        The time of each stage [s].
    """

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)

    def timed(self, stage: str, call: Callable[_P, _R], *args: _P.args, **keywords: _P.kwargs) -> _R:
        """Make a call and add its time to a stage."""
        began = time.perf_counter()
        try:
            return call(*args, **keywords)
        finally:
            self.seconds[stage] += time.perf_counter() - began


class TimedSlam(Slam):
    """A `Slam` that measures time with its `clock`."""

    def __init__(self, config: SlamConfig | None = None, name: str = "robot") -> None:
        self.clock = StageClock()
        super().__init__(config, name)

    def _make_tracker(self) -> Tracker:
        return _TimedTracker(super()._make_tracker(), self.clock)

    def _optimised(self, keyframes: Keyframes) -> OptimisedDrive | None:
        return self.clock.timed("closing", super()._optimised, keyframes)

    def _rendered(self, keyframes: Keyframes) -> TbmGrid:
        return self.clock.timed("rendering", super()._rendered, keyframes)


class _TimedTracker:
    """A tracker with a clock."""

    def __init__(self, tracker: Tracker, clock: StageClock) -> None:
        self._tracker = tracker
        self._clock = clock
        self.grid = tracker.grid
        self.is_novel = tracker.is_novel
        self.revised_poses = tracker.revised_poses

    def match(self, scan: LaserScan, prior: PosePrior, T_robot_sensor: SE2) -> ScanMatch:
        return self._clock.timed("matching", self._tracker.match, scan, prior, T_robot_sensor)

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        self._clock.timed("inserting", self._tracker.learn, scan, match)
