import math

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.odometry_check import OdometryCheck, OdometryCheckConfig


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
