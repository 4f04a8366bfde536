import numpy as np
import pytest

from tbmslam.laser_scan import LaserScan
from tbmslam.monitoring.continuity import ContinuityConfig, changed_share, compare_scans
from tbmslam.se2 import SE2

CONFIG = ContinuityConfig()
ANGLES = np.linspace(-np.pi, np.pi, 360, endpoint=False)


def room(width, height, x=0.0, y=0.0, theta=0.0):
    """Return what a laser sees of a room's four walls, from (x, y) off its middle."""
    cosine, sine = np.cos(ANGLES + theta), np.sin(ANGLES + theta)
    with np.errstate(divide="ignore"):
        across = np.where(cosine > 0, (width / 2 - x) / cosine, (-width / 2 - x) / cosine)
        along = np.where(sine > 0, (height / 2 - y) / sine, (-height / 2 - y) / sine)
    return LaserScan(0.0, -np.pi, np.pi / 180, 0.1, 30.0, np.minimum(across, along))


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_scan_at_its_true_pose_agrees(clockwise):
    before, after = room(6.0, 9.0), room(6.0, 9.0, 1.0, 0.5, 0.7)
    if clockwise:
        after = LaserScan(0.0, np.pi - np.pi / 180, -np.pi / 180, 0.1, 30.0, after.ranges[::-1])
    comparison = compare_scans(before, after, SE2(1.0, 0.5, 0.7), CONFIG)
    assert comparison.contradiction == 0.0
    assert comparison.agreement > 0.98


def test_another_room_contradicts_whatever_the_pose():
    before, after = room(6.0, 9.0), room(12.0, 3.0)
    for theta in np.arange(0.0, 6.0, 0.5):
        assert compare_scans(before, after, SE2(0.0, 0.0, theta), CONFIG).contradiction > CONFIG.max_contradiction


def test_somebody_before_the_laser_is_no_contradiction():
    before, after = room(6.0, 9.0), room(6.0, 9.0)
    after.ranges[:180] = 0.5
    comparison = compare_scans(before, after, SE2.identity(), CONFIG)
    assert comparison.contradiction < 0.01
    assert comparison.agreement < 0.6


def test_scans_without_anything_in_common_tell_nothing():
    nothing = LaserScan(0.0, 0.0, 0.1, 0.1, 30.0, np.full(50, np.inf))
    assert compare_scans(room(6.0, 9.0), nothing, SE2.identity(), CONFIG) == (0.0, 0.0)


def test_near_changes_count_from_the_depth_of_a_door_on_if_both_scans_see_them():
    before, after = room(6.0, 9.0), room(6.0, 9.0)
    assert changed_share(before, after, SE2.identity(), CONFIG) == 0.0
    before.ranges[20:56] -= 0.15
    assert changed_share(before, after, SE2.identity(), CONFIG) == 0.0  # somebody who left
    after.ranges[200:236] -= 0.15
    assert changed_share(before, after, SE2.identity(), CONFIG) == pytest.approx(0.07, abs=0.035)
    assert changed_share(after, before, SE2.identity(), CONFIG) == pytest.approx(0.07, abs=0.035)
    assert compare_scans(before, after, SE2.identity(), CONFIG).contradiction == 0.0
    far = room(60.0, 60.0)
    assert changed_share(far, room(60.5, 60.5), SE2.identity(), CONFIG) == 0.0
