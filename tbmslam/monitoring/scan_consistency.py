"""Scans that contradict the odometry or the previous scan.

A tracker weights the information of the odometry by how well the pose of the scan agrees with it (`ScanMatch.trust`).
Slipping wheels take that weight from single scans, which is normal. Long contradictions are reported, and those after a
pause.
"""

import math

import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracker import PosePrior, ScanMatch

_CONTRADICTED = 0.02
"""Trust below which a scan contradicts the odometry: 18 deviations off."""
_PAUSE_S = 1.5
"""A pause in which a robot may have been carried [s]."""
_STOOD_M = 0.3
"""In a pause the wheels may slip by less while the robot is lifted [m]."""
_WHILE_S = 2.0
"""Time for which scans contradict the odometry before it is reported [s]."""

DISAGREE = "odometry and scans disagree about the motion"
ELSEWHERE = (
    "after a pause the scan shows another place, but the odometry hardly moved: if the robot was carried, "
    "split the recording there with --interval"
)


class Contradictions:
    """Follows the trust in the odometry from scan to scan."""

    def __init__(self) -> None:
        self._last, self._since = -math.inf, math.inf
        self._from = SE2.identity()

    def message_of(self, stamp: float, match: ScanMatch, prior: PosePrior) -> str:
        """Return the warning for a scan at a stamp [s] and its match; "" if there is none."""
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


_NEAR, _NEAR_SHARE = 0.15, 0.03
"""Largest distance between two hits of one surface [m], and its increase per metre of range."""
_FEWEST = 10
_FARTHEST = 40.0
"""Hits beyond are left out, as the tracker leaves them out [m]."""


def agreeing_share(before: LaserScan, after: LaserScan, T_before_after: SE2) -> float:
    """Return the share of a scan's hits in view of the next scan that this confirms; 1 if few are in view.

    Parameters
    ----------
    before, after
        The two scans.
    T_before_after
        Pose of the laser at the later scan in its frame at the earlier scan.
    """
    points = T_before_after.inverse().apply(before.hits(_FARTHEST).points)
    step, beams = after.angle_increment, len(after.ranges)
    if not len(points) or not beams or step == 0.0:
        return 1.0
    ranges, angles = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    turned = (angles - after.angle_min) * np.sign(step) + 0.5 * abs(step)
    beam = (np.remainder(turned, 2.0 * np.pi) / abs(step)).astype(np.int64)
    there = np.where(beam < beams, after.ranges[np.minimum(beam, beams - 1)], np.nan)
    known = ~np.isnan(there)
    if np.count_nonzero(known) < _FEWEST:
        return 1.0
    return float(np.mean(np.abs(there[known] - ranges[known]) <= _NEAR + _NEAR_SHARE * ranges[known]))
