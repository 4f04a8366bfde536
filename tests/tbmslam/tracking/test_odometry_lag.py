import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.tracking.odometry_lag import OdometryLag

STEP = 0.2


def reading(stamp, pose):
    return Reading(LaserScan(stamp, 0.0, 0.1, 0.0, 10.0, np.ones(3)), pose)


@given(st.floats(-0.3, 0.3), st.floats(-1.5, 1.5), st.floats(-2.0, 2.0))
def test_steps_are_moved_along_arcs(lag, speed, rate):
    """The robot starts from rest, so that the steps differ from those of the odometry only in between."""

    def at(stamp):
        return SE2(3.0, -2.0, 2.0) @ SE2.exp(0.5 * speed * stamp**2, 0.0, 0.5 * rate * stamp**2)

    odometry = OdometryLag()
    odometry.value = lag
    stamps = [STEP * k for k in range(1, 6)]
    found = [odometry.pose_at(reading(stamp, at(stamp))) for stamp in stamps]
    assert found[:2] == [at(stamps[0]), pytest.approx(at(stamps[1]))]  # of the first step one speed is unknown
    for (before, after), (first, second) in zip(pairwise(found[1:]), pairwise(stamps[1:]), strict=True):
        # The speed is that of the middle of the last step.
        expected = [
            at(stamp) @ SE2.exp(*(lag * v * (stamp - STEP / 2) for v in (speed, 0, rate))) for stamp in (first, second)
        ]
        assert before.to(after) == pytest.approx(expected[0].to(expected[1]), abs=2e-3)


@pytest.mark.parametrize(
    ("stamp", "pose"),
    [(1.2, SE2(1, 2, 0)), (1.1, SE2(1, 2, 0)), (2.5, SE2(1, 2, 0)), (1.4, SE2(9, 0, 0)), (1.4, SE2(0, 0, 2.0))],
)
def test_steps_stay_as_they_are_where_a_speed_is_unknown(stamp, pose):
    """Where the clock stands, or steps back; after a pause; and where the odometry jumps. Also the step after that."""
    odometry, known = OdometryLag(), SE2(0.1, 0.02, 0.3)
    odometry.value = 0.1
    odometry.pose_at(reading(1.0, SE2.identity()))
    before, after, later = (
        odometry.pose_at(reading(at, there))
        for at, there in ((1.2, known), (stamp, pose), (stamp + 0.2, pose @ SE2(0.2, 0.0, 0.0)))
    )
    assert before.to(after) == pytest.approx(known.to(pose))
    assert after.to(later) == pytest.approx((0.2, 0.0, 0.0))


def test_odometry_may_be_missing_and_may_be_left_as_it_is():
    poses = [None, SE2.identity(), None, SE2(1.0, 0.0, 0.0), SE2(1.1, 0.0, 0.0), SE2(1.3, 0.0, 0.0), None]
    for is_learnt, last in ((True, 1.35), (False, 1.3)):
        odometry = OdometryLag(is_learnt)
        odometry.value = 0.1
        found = [odometry.pose_at(reading(STEP * k, pose)) for k, pose in enumerate(poses)]
        assert found[:4] == poses[:4]
        assert found[4:] == [pytest.approx(poses[4]), pytest.approx((last, 0.0, 0.0)), None]


def test_a_reading_is_moved_once():
    odometry, now = OdometryLag(), reading(STEP, SE2(0.1, 0.0, 0.0))
    odometry.pose_at(reading(0.0, SE2.identity()))
    odometry.value = 0.1
    assert odometry.pose_at(now) is odometry.pose_at(now)


def learnt(lag, seed=0, slips=0.0, share=1.0, turning=0.6, circling=0.0, drift=0.0, keyframes=200):
    """Return the lag that is learnt from a winding drive with a keyframe each third scan.

    The robot also turns by `circling` [rad/s] all along, and the odometry lacks `drift` [rad] at each keyframe.
    """
    odometry, generator, deviation = OdometryLag(), np.random.default_rng(seed), 0.01

    def heading(stamp):
        return turning * 2.0 * math.sin(0.5 * stamp) + circling * stamp

    keyframe, there = SE2.identity(), 0.0
    for k in range(3 * keyframes):
        now = reading(STEP * k, SE2(0.1 * k, 0.0, heading(STEP * k - lag)))
        pose = odometry.pose_at(now)
        if k % 3:
            continue
        here = heading(now.scan.stamp)
        noise = generator.normal(drift, deviation) + (0.8 if generator.uniform() < slips else 0.0)
        if k:
            odometry.learn(share * (wrap_angle(here - there - keyframe.to(pose).theta) + noise), deviation, share)
        # As in the motion model: what was learnt just now does not move this pose.
        keyframe, there = odometry.pose_at(now), here
        odometry.begin_at_keyframe()
    return odometry.value


@pytest.mark.parametrize("lag", [-0.2, 0.0, 0.1])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_the_lag_is_learnt_from_turns(lag, share):
    found = [learnt(lag, seed, share=share) for seed in range(5)]
    assert found == pytest.approx([lag] * 5, abs=0.02)


def test_slipping_wheels_are_no_lag():
    assert [learnt(0.05, seed, slips=0.05) for seed in range(5)] == pytest.approx([0.05] * 5, abs=0.02)


@pytest.mark.parametrize("circling", [0.0, 0.5])
def test_nothing_is_learnt_where_the_turning_speed_stays_the_same(circling):
    assert learnt(0.2, turning=0.0, circling=circling, drift=0.02) == pytest.approx(0.0, abs=1e-9)
