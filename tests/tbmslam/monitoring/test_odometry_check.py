import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.odometry_check import OdometryCheck, OdometryCheckConfig, odometry_scale
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, odometry
from tbmslam.tracking.tracker import ScanMatch


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


def test_a_step_beyond_what_is_usual_is_a_jump():
    check = OdometryCheck(OdometryCheckConfig())
    assert not any(check.jumps(0.1 * k, at(k, 0.05)) for k in range(40))
    assert check.jumps(4.0, at(40 + 20, 0.05))
    assert not check.jumps(4.1, at(41 + 20, 0.05))
    assert not check.jumps(24.1, at(400, 0.05))  # a pause: the speed is what counts
    assert not check.jumps(24.2, None)
    assert not check.jumps(24.3, SE2(math.pi, 50.0, 0.0))


def test_without_experience_nothing_is_a_jump():
    check = OdometryCheck(OdometryCheckConfig())
    assert not check.jumps(0.0, at(0))
    assert not check.jumps(0.1, at(100))


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
