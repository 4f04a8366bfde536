"""Whether a scan shows another place than the one before it, or only what nobody has seen yet."""

import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan

_NEAR, _NEAR_SHARE = 0.15, 0.03
"""Distance between two ranges of one surface [m], and more of it per metre, as beams fall beside each other."""
_FEWEST = 10
_FARTHEST = 40.0
"""Hits beyond are left out, as the tracker leaves them out [m]."""


def agreeing_share(before: LaserScan, after: LaserScan, T_before_after: SE2) -> float:
    """Return which share of the hits of a scan the next one confirms, of those in its view; 1 where these are few.

    Parameters
    ----------
    before, after
        The two scans.
    T_before_after
        Pose of the laser at the later one as seen from the earlier.
    """
    points = T_before_after.inverse().apply(before.hits(_FARTHEST).points)
    step, beams = after.angle_increment, len(after.ranges)
    if not len(points) or not beams or step == 0.0:
        return 1.0
    ranges, angles = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    turned = (angles - after.angle_min) * np.sign(step) + 0.5 * abs(step)
    beam = (np.remainder(turned, 2.0 * np.pi) / abs(step)).astype(np.int64)
    there = np.where(beam < beams, after.ranges[np.minimum(beam, beams - 1)], np.nan)
    told = ~np.isnan(there)
    if np.count_nonzero(told) < _FEWEST:
        return 1.0
    return float(np.mean(np.abs(there[told] - ranges[told]) <= _NEAR + _NEAR_SHARE * ranges[told]))
