import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.odometry_check import (
    DISAGREE,
    ELSEWHERE,
    Contradictions,
    OdometryCheck,
    OdometryCheckConfig,
    agreeing_share,
    odometry_scale,
)
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, odometry
from tbmslam.tracking.tracker import PosePrior, ScanMatch


def at(k, speed=0.3):
    return SE2(speed * k, 0.0, 0.0)


def test_odometry_that_drifts_agrees():
    check = OdometryCheck(OdometryCheckConfig())
    assert not any(check.disagrees(at(k, 0.28), SE2(5.0 + 0.3 * k, 2.0, 0.01 * k)) for k in range(50))


def test_odometry_that_slips_or_turns_disagrees_and_then_again_only_after_a_while():
    for wheels in (at(10, 0.6), SE2(3.0, 0.0, 1.0)):
        check = OdometryCheck(OdometryCheckConfig())
        said = [check.disagrees(at(k) if k < 10 else wheels @ at(k - 10), at(k)) for k in range(30)]
        assert said == [k == 10 for k in range(30)]
    assert not check.disagrees(None, at(31))
    assert not check.disagrees(at(99), at(32))


def test_after_a_jump_only_later_motions_are_compared():
    check = OdometryCheck(OdometryCheckConfig())
    assert not any(check.disagrees(at(k), at(k)) for k in range(10))
    check.forget()
    assert not any(check.disagrees(SE2(90.0, 0.0, 1.0) @ at(k), at(k)) for k in range(10, 20))
    assert check.disagrees(at(20), at(20))


ROOM = np.diag([4e4, 4e4, 1e5])
SCALE, LENGTHS = 0.06, 10
MOUNT = SE2(0.3, 0.0, 0.0)


def keyframe(k, scans, wheels, information=ROOM):
    """Return a keyframe where scans and wheels say that the robot came so far [m]."""
    scan = LaserScan(0.5 * k, -1.0, 0.1, 0.1, 30.0, np.ones(20))
    match = ScanMatch(SE2(scans, 0.0, 0.0) @ MOUNT, 0.9, True, information)
    prior = np.diag([0.02**-2.0, 0.02**-2.0, 0.02**-2.0])
    return TrackedKeyframe.of(k, scan, MOUNT, match, prior, None if wheels is None else SE2(wheels, 0.0, 0.0))


def scale_of(drive):
    return odometry_scale(drive, odometry(drive), SCALE, LENGTHS)


@pytest.mark.parametrize(
    ("speed", "told"), [(0.33, 1.0 / 1.1), (0.24, 1.25), (0.29, 1.0), (0.3, 1.0), (0.15, 2.0), (30.0, 0.01)]
)
def test_lengths_that_differ_all_along_are_a_wrong_scale(speed, told):
    drive = [keyframe(k, 0.3 * k, speed * k) for k in range(60)]
    assert math.isclose(scale_of(drive), told)


def test_lengths_that_scans_do_not_determine_are_not_compared():
    """Along bare walls, and where a laser sees hardly anything, no advice is given."""
    for information in (np.diag([10.0, 4e4, 1e5]), np.zeros((3, 3)), None):
        drive = [keyframe(k, 0.24 * k, 0.3 * k, ROOM if k < 5 else information) for k in range(60)]
        assert scale_of(drive) == 1.0


def test_a_matcher_that_does_not_say_is_believed():
    drive = [keyframe(k, 0.24 * k, 0.3 * k, None) for k in range(60)]
    assert math.isclose(scale_of(drive), 0.8)


def test_wheels_that_slip_stand_still_or_are_silent_for_a_while_tell_no_scale():
    x, drive = 0.0, []
    for k in range(100):
        x += 0.9 if 20 < k < 40 else 0.0 if 60 < k < 80 else 0.3
        drive.append(keyframe(k, 0.3 * k, None if k % 37 == 0 else x))
    assert scale_of(drive) == 1.0


def test_a_short_way_and_none_tell_no_scale():
    assert scale_of([keyframe(k, 0.3 * k, 0.25 * k) for k in range(30)]) == 1.0
    assert scale_of([]) == 1.0
    assert scale_of([keyframe(k, 0.3 * k, None) for k in range(60)]) == 1.0


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


def test_long_contradictions_of_scans_are_reported_and_single_scans_are_not():
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
