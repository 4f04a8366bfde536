"""Scans that contradict the odometry: after a pause, or for a while, as where a laser sends one scan again and again.

A tracker weighs the odometry's information by how well the scan's place agrees with it (`ScanMatch.trust`). Wheels that
slip take that weight from single scans, which is no news.
"""

import math

from tbmslam.geometry.se2 import SE2
from tbmslam.tracking.tracker import PosePrior, ScanMatch

_CONTRADICTED = 0.02
"""Trust below which a scan contradicts the odometry: 18 deviations off."""
_PAUSE_S = 1.5
"""A pause in which a robot may be carried."""
_STOOD_M = 0.3
"""Wheels that moved the robot by less in a pause may have slipped as it was lifted [m]."""
_WHILE_S = 2.0
"""Time [s] for which scans contradict odometry one after the other until it is told."""

DISAGREE = "odometry and scans disagree about the motion"
ELSEWHERE = (
    "after a pause the robot does not stand where it stood before, though the wheels hardly moved: if it was carried, "
    "make one robot of the drive before and one of the drive after by --interval"
)


class Contradictions:
    """Watches how far the odometry is trusted beside the scans."""

    def __init__(self) -> None:
        self._last, self._since = -math.inf, math.inf
        self._from = SE2.identity()

    def told_by(self, stamp: float, match: ScanMatch, prior: PosePrior) -> str:
        """Return what is to be said of a scan at a stamp [s] and where it was placed; "" where nothing is."""
        pause, self._last = stamp - self._last, stamp
        before, self._from = self._from, prior.start
        if match.trust >= _CONTRADICTED or not (prior.by_odometry and match.moved):
            self._since = math.inf
            return ""
        stood = math.hypot(prior.start.x - before.x, prior.start.y - before.y) < _STOOD_M
        if stood and _PAUSE_S < pause < math.inf:
            self._since = stamp
            return ELSEWHERE
        self._since = min(self._since, stamp)
        return DISAGREE if stamp - self._since >= _WHILE_S else ""
