import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.tracking.constant_velocity import ConstantVelocity
from tbmslam.tracking.motion_config import MotionConfig
from tbmslam.tracking.odometry_noise import OdometryNoiseConfig

STEP = 0.2


def at(*poses, config=None):
    """Return the model after some poses, STEP seconds apart."""
    model = ConstantVelocity(config or MotionConfig())
    for number, pose in enumerate(poses):
        model.follow(STEP * number, pose, stops=False)
    return model


def test_the_motion_goes_on():
    model = at(SE2.identity())
    assert model.pose(0.1) == (0, 0, 0)
    model.follow(0.1, SE2(0.1, 0, 0.05), stops=False)
    ahead = model.pose(0.3)
    assert ahead.theta == pytest.approx(0.15)
    assert math.hypot(ahead.x, ahead.y) == pytest.approx(0.3, rel=0.01)
    # A stamp that steps back predicts no motion backwards, and a long pause no flight.
    assert model.pose(0.05) == pytest.approx((0.1, 0, 0.05))
    assert model.pose(500.0).x < 1.2


def test_the_motion_that_a_robot_stops_is_forgotten():
    model = at(SE2.identity(), SE2(0.1, 0.0, 0.0))
    model.follow(0.4, SE2(0.3, 0.0, 0.0), stops=True)
    assert model.pose(0.6) == pytest.approx((0.3, 0.0, 0.0))
    assert model.motion(0.1) == (0, 0, 0)


def test_a_robot_that_was_not_seen_for_seconds_may_have_gone_anywhere_near_its_last_pose():
    model = at(SE2.identity(), SE2(0.1, 0.0, 0.0))
    coasting = model.coasting(4.2)
    assert coasting.mean == SE2(0.1, 0.0, 0.0)
    assert coasting.deviations == pytest.approx((4.005, 4.005, 4.005))
    assert model.coasting(6.2) is None


def test_a_second_pose_of_the_same_moment_leaves_the_motion_as_it_was():
    model = at(SE2.identity(), SE2(0.1, 0.0, 0.0))
    model.follow(STEP, SE2(0.1, 0.0, 0.0), stops=False)
    assert model.pose(2 * STEP) == pytest.approx((0.2, 0.0, 0.0))


def test_a_pose_swerves_by_its_distance_from_the_last_motion():
    model = at(SE2.identity(), SE2(0.1, 0.0, 0.0))
    assert model.swerve(SE2(0.2, 0.0, 1.0), 2 * STEP) == pytest.approx(0.0)
    assert model.swerve(SE2(-0.1, 0.4, 0.0), 2 * STEP) == pytest.approx(0.5)


@pytest.mark.parametrize("stamp", [STEP, STEP - 5.0])
def test_a_pose_swerves_from_the_last_pose_also_where_stamps_repeat_or_step_back(stamp):
    model = at(SE2.identity(), SE2(0.1, 0.0, 0.0))
    model.follow(stamp, SE2(0.2, 0.0, 0.0), stops=False)
    assert model.swerve(SE2(0.3, 0.0, 0.0), stamp + STEP) == pytest.approx(0.0)


@pytest.mark.parametrize("deviation", [0.02, 0.05, 0.3])
def test_the_change_of_the_turning_speed_is_learnt(deviation):
    """Also from scans that determine the heading to three quarters."""
    for share in (1.0, 0.75):
        learnt = []
        for seed in range(5):
            model, generator = at(SE2.identity(), SE2.identity()), np.random.default_rng(seed)
            for _ in range(150):
                stated = model.deviations(2 * STEP)[2]
                # A scan of variance r determines the share s of a prior of variance d^2: s = d^2 / (d^2 + r).
                change = generator.normal(0.0, deviation)
                seen = change + generator.normal(0.0, math.sqrt(1.0 / share - 1.0) * deviation)
                kept = stated**2 / (stated**2 + (1.0 / share - 1.0) * deviation**2)
                model.learn(kept * seen, stated, kept)
            learnt.append(model.deviations(2 * STEP)[2])
        assert np.median(learnt) == pytest.approx(deviation, rel=0.3)
        assert model.deviations(2 * STEP)[:2] == pytest.approx((0.105, 0.105))


def test_nothing_is_learnt_where_learning_is_off():
    model = at(SE2.identity(), config=MotionConfig(odometry=OdometryNoiseConfig(learning=False)))
    before = model.deviations(STEP)
    model.learn(0.0, 0.1, 1.0)
    assert model.deviations(STEP) == before
