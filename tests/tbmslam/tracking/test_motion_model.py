import math
from dataclasses import replace

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.sensing.segmentation import in_frame
from tbmslam.tracking.motion_config import MotionConfig
from tbmslam.tracking.motion_model import MotionModel
from tbmslam.tracking.odometry_noise import OdometryNoiseConfig


def reading(stamp, pose):
    return Reading(LaserScan(stamp, 0.0, 0.1, 0.0, 10.0, np.ones(3)), pose)


def test_the_first_reading_lies_at_its_odometry_pose():
    assert MotionModel(MotionConfig()).predict(reading(0.0, SE2(1, 2, 3))).mean == (1, 2, 3)
    assert MotionModel(MotionConfig()).predict(reading(0.0, None)).mean == (0, 0, 0)


def test_a_step_is_taken_in_the_robots_frame():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2(5, 5, 0)), SE2(0, 0, math.pi / 2))
    prediction = model.predict(reading(1.0, SE2(6, 5, 0)))
    assert prediction.mean == pytest.approx((0.0, 1.0, math.pi / 2))


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
    assert model.predict(reading(1.0, SE2(6, 5, 0.1))).mean == pytest.approx((1.0, 0.0, math.pi / 2 + 0.1))


def test_longer_steps_are_less_certain():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2(0, 0, 0)), SE2.identity())
    short = model.predict(reading(0.1, SE2(0.01, 0, 0))).deviations
    far = model.predict(reading(0.1, SE2(1.0, 0, 0))).deviations
    turned = model.predict(reading(0.1, SE2(0, 0, 1.0))).deviations
    assert np.greater(far, short).all()
    assert np.greater(turned, short).all()


def test_a_step_that_no_robot_makes_is_not_believed():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2(0, 0, 0)), SE2.identity())
    prediction = model.predict(reading(0.1, SE2(1e30, 0, 0)))
    assert prediction.jump == pytest.approx(1e30)
    assert prediction.mean == prediction.start == SE2.identity()
    assert not prediction.by_odometry
    assert model.predict(reading(10.0, SE2(100.0, 0, 0))).jump == 0.0
    assert model.predict(reading(0.1, SE2(1.9, 0, 0))).mean.x == pytest.approx(1.9)


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


def driven(model, number, distance=0.4, turn=0.2):
    """Drive an arc in some number of readings after a keyframe; return the last prior."""
    model.correct(reading(0.0, SE2.identity()), SE2.identity())
    for k in range(1, number + 1):
        part = k / number
        now = reading(2.0 * part, SE2.exp(distance * part, 0.0, turn * part))
        prior = model.predict(now)
        model.correct(now, prior.start)
    return prior


def test_the_rate_of_scans_does_not_change_the_deviations():
    once, often = (driven(MotionModel(MotionConfig()), number) for number in (1, 20))
    assert often.deviations == pytest.approx(once.deviations, rel=0.01)
    assert often.mean == pytest.approx(once.mean, abs=1e-9)
    assert often.deviations[0] == pytest.approx(0.005 + 0.05 * 0.4 + 0.05 * 0.2, rel=0.01)
    assert often.deviations[2] == pytest.approx(0.005 + 0.05 * 0.4 + 0.1 * 0.2, rel=0.01)


def test_the_mean_goes_on_from_the_last_keyframe_and_the_search_from_the_last_scan():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2(5.0, 5.0, 0.0)), SE2.identity())
    model.correct(reading(0.5, SE2(5.1, 5.0, 0.0)), SE2(0.1, 0.03, 0.02))
    prior = model.predict(reading(1.0, SE2(5.2, 5.0, 0.0)))
    assert prior.by_odometry
    assert prior.mean == pytest.approx((0.2, 0.0, 0.0))
    assert prior.start == pytest.approx(SE2(0.1, 0.03, 0.02) @ SE2(0.1, 0.0, 0.0))
    coasting = prior.coasting()
    assert coasting.mean == pytest.approx(SE2(0.1, 0.03, 0.02) @ SE2(0.1, 0.03, 0.02), abs=2e-3)
    assert coasting.deviations == pytest.approx((0.255, 0.255, 0.255))
    model.begin_at_keyframe(reading(0.5, SE2(5.1, 5.0, 0.0)), SE2(0.1, 0.03, 0.02))
    prior = model.predict(reading(1.0, SE2(5.2, 5.0, 0.0)))
    assert prior.mean == pytest.approx(prior.start)


def test_inertia_says_nothing_beside_a_prior_that_comes_from_it():
    model = MotionModel(MotionConfig())
    for stamp in (0.0, 0.5):
        model.correct(reading(stamp, None), SE2(stamp, 0.0, 0.0))
    prior = model.predict(reading(1.0, None))
    assert not prior.by_odometry
    assert prior.coasting() is None


def test_after_a_jump_the_odometry_counts_from_where_the_scan_was_placed():
    model = MotionModel(MotionConfig())
    driven(model, 4)
    far = SE2(40.0, -9.0, 2.0)
    model.predict(reading(2.5, far))
    model.correct(reading(2.5, far), SE2(0.5, 0.1, 0.3))
    prior = model.predict(reading(3.0, far @ SE2(0.1, 0.0, 0.0)))
    assert prior.mean == pytest.approx(SE2(0.5, 0.1, 0.3) @ SE2(0.1, 0.0, 0.0))
    before, after = driven(MotionModel(MotionConfig()), 4).deviations, model.deviations_since_keyframe(prior)
    # Before the jump, half a second without odometry, and after it.
    without = 0.005 + 0.5 * 0.5
    assert after == pytest.approx(np.sqrt(np.square(before) + without**2 + np.square(prior.deviations)), rel=0.01)


def test_odometry_that_is_at_its_origin_after_a_pause_may_have_begun_anew():
    model = MotionModel(MotionConfig())
    pose = SE2(0.4, 0.1, 0.3)
    for stamp in (0.0, 0.5):
        model.correct(reading(stamp, SE2(8.0 * stamp, 2.0, 0.0)), pose)
    assert model.predict(reading(1.4, SE2.identity())).stood is None  # no pause
    assert model.predict(reading(600.0, SE2(2.0, 2.0, 0.0))).stood is None  # no far step
    assert model.predict(reading(600.0, SE2(0.0, 0.2, 0.0))).stood is None  # not the origin
    stood = model.predict(reading(600.0, SE2.identity())).stood
    assert stood is not None
    assert stood.mean == pose
    assert max(stood.deviations) < 1.0
    moved = in_frame(reading(600.0, SE2.identity()), SE2(4.0, 2.5, 0.0) @ SE2(0.0, 0.0, 1.0))
    assert model.predict(moved).stood is None  # near in this frame
    assert model.predict(in_frame(reading(600.0, SE2.identity()), SE2(1.0, -2.5, 1.0))).stood is not None


def test_the_origin_of_odometry_that_comes_late_is_found():
    """The lag moves the odometry to the time of the scans, which leaves its frame arbitrary."""
    model = MotionModel(MotionConfig())
    model._lag.value = 0.1
    pose = SE2.identity()
    for k in range(60):
        stamp = 0.1 * k + (0.9 if k > 40 else 0.0)  # a gap at the end of a turn
        pose = pose @ SE2(0.1, 0.0, 0.1 if 30 < k <= 40 else 0.0)
        each = reading(stamp, pose)
        model.predict(each)
        model.correct(each, pose)
    assert model.predict(reading(600.0, SE2.identity())).stood is not None


@pytest.mark.parametrize("stood", [True, False])
def test_after_a_pause_the_odometry_counts_from_where_the_scan_was_placed(stood):
    model = MotionModel(MotionConfig())
    for stamp in (0.0, 0.5):
        model.predict(reading(stamp, SE2(8.0 * stamp, 2.0, 0.0)))
        model.correct(reading(stamp, SE2(8.0 * stamp, 2.0, 0.0)), SE2(8.0 * stamp, 2.0, 0.0))
    model.begin_at_keyframe(reading(0.5, SE2(4.0, 2.0, 0.0)), SE2(4.0, 2.0, 0.0))
    model.predict(reading(600.0, SE2.identity()))
    model.correct(reading(600.0, SE2.identity()), SE2(4.1, 2.0, 0.1) if stood else SE2(0.1, 0.0, 0.1))
    assert model.began_anew == stood
    prior = model.predict(reading(600.5, SE2(0.2, 0.0, 0.0)))
    # Between keyframes the odometry counts from the last of them, unless it began anew.
    assert prior.mean == pytest.approx(SE2(4.1, 2.0, 0.1) @ SE2(0.2, 0.0, 0.0) if stood else SE2(0.2, 0.0, 0.0))


def test_a_keyframe_forgets_how_the_robot_came_there():
    model = MotionModel(MotionConfig())
    far = driven(model, 4)
    assert model.deviations_since_keyframe(far) == pytest.approx(far.deviations)
    model.begin_at_keyframe(reading(2.0, SE2.exp(0.4, 0.0, 0.2)), far.mean)
    near = model.predict(reading(2.1, SE2.exp(0.4, 0.0, 0.2)))
    assert near.deviations == pytest.approx((0.005, 0.005, 0.005))
    assert model.deviations_since_keyframe(near) == pytest.approx(near.deviations)


@pytest.mark.parametrize("number", [1, 5])
def test_deviations_without_odometry_add_up_since_the_keyframe(number):
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, None), SE2.identity())
    for k in range(1, number + 1):
        now = reading(0.2 * k, None)
        prior = model.predict(now)
        assert not prior.by_odometry
        assert prior.deviations == pytest.approx((0.105,) * 3)
        model.correct(now, SE2.identity())
    assert model.deviations_since_keyframe(prior) == pytest.approx((math.sqrt(number) * 0.105,) * 3)


@pytest.mark.parametrize(("is_lost", "turn"), [(False, 0.6), (True, 0.4)])
def test_without_odometry_a_lost_scan_ends_the_motion(is_lost, turn):
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, None), SE2.identity())
    model.correct(reading(0.2, None), SE2(0.0, 0.0, 0.2))
    lost = reading(0.4, None)
    model.correct(lost, model.predict(lost).mean, is_lost)
    assert model.predict(reading(0.6, None)).mean == pytest.approx((0.0, 0.0, turn))


def test_keyframes_teach_how_good_the_odometry_is():
    """A heading that is wrong by 0.1 rad each time, seen by a laser ahead of the robot's middle."""
    mount = SE2(0.4, 0.0, 0.3)
    prior, model = None, MotionModel(MotionConfig())
    model.correct(reading(0.0, SE2.identity()), SE2.identity())
    stated = model.predict(reading(0.1, SE2(0.1, 0.0, 0.0)))
    for _ in range(50):
        model.learn(stated._replace(by_odometry=False), SE2(0.1, 0.0, 0.1), np.eye(3) * 1e6, mount)
    assert model.predict(reading(0.1, SE2(0.1, 0.0, 0.0))).motion == stated.motion
    for _ in range(20):
        prior = model.predict(reading(0.1, SE2(0.1, 0.0, 0.0)))
        model.learn(prior, SE2(0.1, 0.0, 0.1), np.eye(3) * 1e6, mount)
    assert prior.deviations[2] > 3.0 * stated.deviations[2]
    assert max(prior.deviations[:2]) < 0.6 * stated.deviations[0]


def test_a_keyframe_that_no_scan_placed_hands_its_deviations_on():
    mount, step = SE2.identity(), SE2(0.4, 0.0, 0.0)
    for information, within in ((None, (1.3, 1.5)), (np.eye(3) * 1e9, (0.99, 1.01))):
        model = MotionModel(MotionConfig(odometry=OdometryNoiseConfig(learning=False)))
        model.correct(reading(0.0, SE2.identity()), SE2.identity())
        first = model.predict(reading(1.0, step))
        model.correct(reading(1.0, step), first.mean)
        model.learn(first, first.mean, information, mount)
        model.begin_at_keyframe(reading(1.0, step), first.mean)
        second = model.predict(reading(2.0, step @ step))
        assert second.motion == pytest.approx(first.motion)
        grown = np.divide(second.deviations, first.deviations)
        assert within[0] < grown.min() <= grown.max() < within[1]
        model.correct(reading(2.0, step @ step), second.mean)
        assert model.deviations_since_keyframe(second) == pytest.approx(second.motion)


def test_odometry_that_begins_late_counts_from_its_first_pose():
    model = MotionModel(MotionConfig())
    model.correct(reading(0.0, None), SE2.identity())
    for k in (1, 2):
        now = reading(0.1 * k, SE2(5.0 + 0.1 * k, 0.0, 0.0))
        prior = model.predict(now)
        assert prior.by_odometry == (k == 2)
        model.correct(now, SE2(0.1 * k, 0.0, 0.0))
    assert prior.mean == pytest.approx((0.2, 0.0, 0.0))
