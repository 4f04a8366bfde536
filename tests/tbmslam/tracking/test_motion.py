import math
from dataclasses import replace

import numpy as np
import pytest

from tbmslam.laser_scan import LaserScan, Reading
from tbmslam.se2 import SE2
from tbmslam.tracking.motion import MotionConfig, MotionModel


def reading(stamp, pose):
    return Reading(LaserScan(stamp, 0.0, 0.1, 0.0, 10.0, np.ones(3)), pose)


def test_the_first_reading_lies_at_its_odometry_pose():
    assert MotionModel(MotionConfig()).predict(reading(0.0, SE2(1, 2, 3))).T_map_robot == (1, 2, 3)
    assert MotionModel(MotionConfig()).predict(reading(0.0, None)).T_map_robot == (0, 0, 0)


def test_a_step_is_taken_in_the_robots_frame():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2(5, 5, 0)), SE2(0, 0, math.pi / 2))
    prediction = model.predict(reading(1.0, SE2(6, 5, 0)))
    assert prediction.T_map_robot == pytest.approx((0.0, 1.0, math.pi / 2))


@pytest.mark.parametrize("odometry", [True, False])
def test_the_motion_during_a_scan_goes_on_as_before(odometry):
    model = MotionModel(MotionConfig())
    steps = [SE2(0.1 * k, 0.0, 0.0) for k in range(3)]
    for k in range(2):
        model.correct(reading(0.2 * k, steps[k] if odometry else None), steps[k])
    now = reading(0.4, steps[2] if odometry else None)
    assert model.motion_after(now, 0.1) == pytest.approx((0.05, 0.0, 0.0))
    assert model.motion_after(now, 0.0) == (0, 0, 0)
    assert model.motion_to(now, SE2(0.5, 0.0, 0.0), 0.1) == pytest.approx((0.2, 0.0, 0.0))
    assert MotionModel(MotionConfig()).motion_to(now, SE2(0.5, 0.0, 0.0), 0.1) == (0, 0, 0)


def test_odometry_at_the_last_beam_tells_the_motion_during_a_scan():
    now = replace(reading(0.0, SE2(1, 2, math.pi / 2)), T_odom_swept=SE2(1, 2.5, math.pi / 2))
    assert MotionModel(MotionConfig()).motion_after(now, 0.1) == pytest.approx((0.5, 0.0, 0.0))


def test_the_original_adds_components():
    model = MotionModel(MotionConfig(composition="component"))
    model.correct(reading(0.0, SE2(5, 5, 0)), SE2(0, 0, math.pi / 2))
    assert model.predict(reading(1.0, SE2(6, 5, 0.1))).T_map_robot == pytest.approx((1.0, 0.0, math.pi / 2 + 0.1))


def test_longer_steps_are_less_certain():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2(0, 0, 0)), SE2.identity())
    short = model.predict(reading(0.1, SE2(0.01, 0, 0))).deviations
    far = model.predict(reading(0.1, SE2(1.0, 0, 0))).deviations
    turned = model.predict(reading(0.1, SE2(0, 0, 1.0))).deviations
    assert (far > short).all()
    assert (turned > short).all()


def test_without_odometry_the_motion_goes_on():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, None), SE2(0, 0, 0))
    assert model.predict(reading(0.1, None)).T_map_robot == (0, 0, 0)
    model.correct(reading(0.1, None), SE2(0.1, 0, 0.05))
    ahead = model.predict(reading(0.3, None)).T_map_robot
    assert ahead.theta == pytest.approx(0.15)
    assert math.hypot(ahead.x, ahead.y) == pytest.approx(0.3, rel=0.01)
    # A stamp that steps back predicts no motion backwards, and a long pause no flight.
    assert model.predict(reading(0.05, None)).T_map_robot == pytest.approx((0.1, 0, 0.05))
    assert model.predict(reading(500.0, None)).T_map_robot.x < 1.2


def test_a_step_that_no_robot_makes_is_not_believed():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2(0, 0, 0)), SE2.identity())
    prediction = model.predict(reading(0.1, SE2(1e30, 0, 0)))
    assert prediction.jump == pytest.approx(1e30)
    assert prediction.T_map_robot == SE2.identity()
    assert model.predict(reading(10.0, SE2(100.0, 0, 0))).jump == 0.0
    assert model.predict(reading(0.1, SE2(1.9, 0, 0))).T_map_robot.x == pytest.approx(1.9)


def believed(steps, seconds=0.05):
    """Tell of each of some steps of the odometry [m] whether it is believed."""
    model, x, answers = MotionModel(MotionConfig()), 0.0, []
    model.correct(reading(0.0, SE2.identity()), SE2.identity())
    for number, step in enumerate(steps, 1):
        x += step
        now = reading(seconds * number, SE2(x, 0, 0))
        answers.append(model.predict(now).jump == 0.0)
        model.correct(now, SE2.identity())
    return answers


def test_steps_that_each_might_be_a_jump_cannot_all_be_one():
    """As where a robot at half a metre a second tells centimetres, even after it stood still."""
    assert not any(believed([2.5] * 40)[1:])
    assert not any(believed([2.5] * 40 + [0.0] * 30 + [2.5] * 20)[70:])


def test_after_a_jump_the_odometry_is_believed_again():
    assert believed([0.05] * 5 + [30.0] + [0.05] * 30) == [True] * 5 + [False] + [True] * 30
    assert believed([0.05] * 5 + [1.9] + [0.05] * 30) == [True] * 36


def test_odometry_that_was_impossible_for_a_while_is_believed_in_the_end():
    assert believed([5.0] * 20 + [0.05] * 600)[-1]


def test_odometry_that_stands_still_while_scans_move_on_is_not_believed():
    model = MotionModel(MotionConfig())
    for k in range(5):  # the scans go on by 15 cm each
        now = reading(0.1 * k, SE2(1.0, 2.0, 0.5))
        prediction = model.predict(now)
        assert prediction.is_frozen == (k == 4)
        model.correct(now, SE2(0.15 * k, 0.0, 0.0))
    assert prediction.T_map_robot == pytest.approx((0.6, 0.0, 0.0))  # as it moved before
    assert model.predict(reading(0.5, SE2(1.3, 2.0, 0.5))).is_frozen is False


def test_a_robot_that_stands_is_believed_to_stand():
    model = MotionModel(MotionConfig())
    for k in range(100):
        now = reading(0.1 * k, SE2(1.0, 2.0, 0.5))
        assert not model.predict(now).is_frozen
        model.correct(now, SE2(0.05 * (k % 2), 0.0, 0.1))


def test_odometry_that_scans_contradict_is_doubted():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2.identity()), SE2.identity())
    stated = model.predict(reading(0.1, SE2(0.1, 0.0, 0.0)))
    assert stated.by_odometry
    for _ in range(50):
        model.learn(stated, stated.T_map_robot, stated.T_map_robot, None)
        without = stated._replace(by_odometry=False)
        model.learn(without, stated.T_map_robot, SE2(0.1, 0.0, 0.1), np.eye(3) * 1e6)
    assert model.predict(reading(0.1, SE2(0.1, 0.0, 0.0))).deviations.tolist() == stated.deviations.tolist()
    for _ in range(5):
        model.learn(
            model.predict(reading(0.1, SE2(0.1, 0.0, 0.0))), SE2(0.1, 0.0, 0.0), SE2(0.1, 0.0, 0.1), np.eye(3) * 1e6
        )
    doubted = model.predict(reading(0.1, SE2(0.1, 0.0, 0.0))).deviations
    assert doubted[2] > 2.0 * stated.deviations[2]
    assert doubted[0] == pytest.approx(stated.deviations[0])
