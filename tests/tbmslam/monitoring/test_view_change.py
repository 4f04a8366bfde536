"""Whether two scans show one place."""

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.view_change import agreeing_share
from tbmslam.sensing.laser_scan import LaserScan

ANGLES = np.linspace(-1.5, 1.5, 151)


def scan(pose, width=2.0, ahead=6.0, increment=0.02):
    """Return what a laser sees in a corridor along x that ends ahead."""
    angles = np.sign(increment) * ANGLES
    x, y = np.cos(angles + pose.theta), np.sin(angles + pose.theta)
    with np.errstate(divide="ignore"):
        aside = np.where(y > 0, (0.5 * width - pose.y) / y, (-0.5 * width - pose.y) / y)
        ranges = np.minimum(np.abs(aside), np.where(x > 0, (ahead - pose.x) / x, np.inf))
    return LaserScan(0.0, angles[0], increment, 0.1, 30.0, ranges)


@pytest.mark.parametrize("increment", [0.02, -0.02])
def test_the_same_place_is_confirmed(increment):
    there = SE2(0.3, 0.1, 0.2)
    before, after = scan(SE2.identity(), increment=increment), scan(there, increment=increment)
    assert agreeing_share(before, after, there) > 0.9
    assert agreeing_share(before, after, SE2(0.3, 0.1, 0.8)) < 0.5


def test_another_place_is_not():
    assert agreeing_share(scan(SE2.identity()), scan(SE2.identity(), width=4.0, ahead=9.0), SE2.identity()) < 0.1


def test_what_was_not_in_view_contradicts_nothing():
    before, after = scan(SE2.identity()), scan(SE2.identity())
    assert agreeing_share(before, after, SE2(0.0, 0.0, np.pi)) == 1.0
    nothing = after.with_ranges(np.full(len(ANGLES), np.nan))
    assert agreeing_share(before, nothing, SE2.identity()) == 1.0
    assert agreeing_share(nothing, before, SE2.identity()) == 1.0
