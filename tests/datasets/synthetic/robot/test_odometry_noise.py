import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datasets.synthetic.robot.odometry_noise import OdometryNoise
from tbmslam.geometry.se2 import SE2, wrap_angles
from tbmslam.geometry.trajectory import Trajectory


def drive_of(twists):
    poses = [SE2(3.0, -2.0, 1.0)]
    for twist in twists:
        poses.append(poses[-1] @ SE2.exp(*twist))
    return Trajectory(np.arange(len(poses)) * 0.02, np.array(poses))


moves = st.floats(-0.02, 0.02).filter(lambda value: abs(value) > 1e-5 or value == 0.0)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(moves, moves, moves), min_size=1, max_size=30))
def test_without_noise_odometry_is_the_drive_in_its_own_frame(twists):
    drive = drive_of(twists)
    odometry = OdometryNoise.preset("none").odometry(drive, np.random.default_rng(0))
    np.testing.assert_array_equal(odometry.poses[0], 0.0)
    back = odometry.transformed(drive.pose(0))
    np.testing.assert_allclose(back.poses[:, :2], drive.poses[:, :2], atol=1e-6)
    np.testing.assert_allclose(wrap_angles(back.poses[:, 2] - drive.poses[:, 2]), 0.0, atol=1e-6)


def end_errors(preset, drive, count=60):
    noise = OdometryNoise.preset(preset)
    ends = [
        noise.odometry(drive, np.random.default_rng(seed)).transformed(drive.pose(0)).poses[-1] for seed in range(count)
    ]
    return np.hypot(*(np.array(ends)[:, :2] - drive.poses[-1, :2]).T)


def test_presets_drift_as_they_say():
    lap = [(0.01, 0.0, 0.0)] * 3000 + [(0.0, 0.0, np.pi / 2 / 100)] * 100 + [(0.01, 0.0, 0.0)] * 500
    lap += [(0.0, 0.0, np.pi / 2 / 100)] * 100
    drive = drive_of(lap * 4)
    assert drive.length() == pytest.approx(140.0)
    assert 0.2 < end_errors("good", drive).mean() < 1.0
    assert 1.5 < end_errors("poor", drive).mean() < 6.0


def test_a_robot_that_stands_or_reverses_is_not_taken_for_one_that_turns():
    noise = OdometryNoise(alpha1=0.5, alpha2=0.0, alpha3=0.0, alpha4=0.0)
    drive = drive_of([(-0.01, 0.0, 0.0)] * 200 + [(0.0, 0.0, 0.0)] * 200)
    odometry = noise.odometry(drive, np.random.default_rng(1))
    np.testing.assert_allclose(odometry.poses[-1], [-2.0, 0.0, 0.0], atol=1e-6)


def test_spread_of_one_step_is_the_books():
    noise = OdometryNoise(alpha1=0.1, alpha2=0.2, alpha3=0.3, alpha4=0.4)
    drive = Trajectory(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [np.cos(0.3), np.sin(0.3), 0.5]]))
    ends = np.array([noise.odometry(drive, np.random.default_rng(seed)).poses[1] for seed in range(4000)])
    # turns 0.3 and 0.2, translation 1 (table 5.6, lines 5 to 7)
    assert ends[:, 2].var() == pytest.approx(0.1 * (0.3**2 + 0.2**2) + 2 * 0.2, rel=0.1)
    mean_square = (ends[:, 0] ** 2 + ends[:, 1] ** 2).mean()
    assert mean_square == pytest.approx(1.0 + 0.3 + 0.4 * (0.3**2 + 0.2**2), rel=0.1)


def test_wrong_noise_is_refused():
    with pytest.raises(ValueError, match="name must be one of none, good, poor, got 'bad'"):
        OdometryNoise.preset("bad")
    with pytest.raises(ValueError, match=r"alpha3 must not be negative, got -1\.0"):
        OdometryNoise(0.0, 0.0, -1.0, 0.0)
