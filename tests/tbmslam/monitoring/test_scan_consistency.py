"""Scans that contradict the odometry after a pause, or for a while."""

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.scan_consistency import DISAGREE, ELSEWHERE, Contradictions, agreeing_share
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracker import PosePrior, ScanMatch

DEVIATIONS = (0.01, 0.01, 0.01)


def told(readings):
    """Return what is said of readings: stamp, way by odometry [m] and trust."""
    progress = Contradictions()
    return [progress.message_of(stamp, match(trust), prior(way)) for stamp, way, trust in readings]


def match(trust, moved=True):
    return ScanMatch(SE2.identity(), 0.9, moved, trust=trust)


def prior(way, by_odometry=True):
    pose = SE2(way, 0.0, 0.0)
    return PosePrior(pose, DEVIATIONS, DEVIATIONS, pose, lambda: pose, by_odometry=by_odometry)


def test_a_robot_that_was_carried_in_a_pause():
    assert told([(0.0, 0.0, 1.5), (0.1, 0.05, 1.5), (2.2, 0.1, 0.005), (2.3, 0.15, 1.5)]) == ["", "", ELSEWHERE, ""]


@pytest.mark.parametrize(("pause", "way", "trust"), [(0.5, 0.1, 0.005), (2.0, 0.9, 0.005), (2.0, 0.1, 0.3)])
def test_one_that_was_not(pause, way, trust):
    assert told([(0.0, 0.0, 1.5), (pause, way, trust)]) == ["", ""]


def test_scans_that_contradict_for_a_while_are_told_and_single_ones_are_not():
    said = told([(0.125 * k, 0.05 * k, 0.01 if 10 <= k < 40 else 1.5) for k in range(60)])
    assert [k for k, what in enumerate(said) if what == DISAGREE] == list(range(26, 40))
    assert not any(told([(0.1 * k, 0.05 * k, 0.01 if k % 10 else 1.5) for k in range(60)]))


def test_without_odometry_or_a_place_nothing_contradicts():
    progress = Contradictions()
    for k in range(60):
        assert progress.message_of(0.1 * k, match(0.01, moved=k % 2 == 0), prior(0.0, by_odometry=k % 2 == 1)) == ""


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
