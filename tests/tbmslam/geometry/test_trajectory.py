import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory, drive_speeds, turn_rates


def square():
    return Trajectory(
        np.array([10.0, 11.0, 12.0, 13.0]),
        np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 1.5], [2.0, 3.0, 3.0], [0.0, 3.0, -2.0]]),
    )


def test_a_robot_at_rest_drives_nowhere(generator):
    """Two hours at 10 Hz, with poses 2 mm off; then ten metres along an arc, at half a metre a second."""
    resting = generator.normal(0.0, 0.002, (72_000, 3))
    turns = np.linspace(0.0, 2.0, 200)
    arc = np.column_stack((5.0 * np.sin(turns), 5.0 * (1.0 - np.cos(turns)), turns))
    arc += generator.normal(0.0, 0.002, arc.shape)
    rest, drive, both = (
        Trajectory(np.arange(len(poses), dtype=float), poses) for poses in (resting, arc, np.vstack((resting, arc)))
    )
    assert rest.length() > 100.0
    assert rest.driven() < 0.02
    assert drive.driven() == pytest.approx(10.0, rel=0.005)
    assert both.driven() == pytest.approx(10.0, rel=0.01)
    assert Trajectory(np.zeros(0), np.zeros((0, 3))).driven() == 0.0


def test_length_is_what_was_travelled():
    assert square().length() == pytest.approx(7.0)


@pytest.mark.parametrize("count", [0, 1])
def test_who_never_moved_travelled_nothing(count):
    trajectory = Trajectory(np.zeros(count), np.zeros((count, 3)))
    assert len(trajectory) == count
    assert trajectory.length() == 0.0


def test_another_frame_changes_poses_as_motions_do():
    T_new_old = SE2(1.0, -2.0, 2.5)
    moved = square().transformed(T_new_old)
    for index in range(4):
        expected = T_new_old @ square().pose(index)
        assert moved.pose(index) == pytest.approx(expected)
        assert -math.pi <= moved.pose(index).theta < math.pi
    np.testing.assert_array_equal(moved.stamps, square().stamps)
    assert moved.length() == pytest.approx(square().length())


def test_stamps_may_step_back_as_recorders_do():
    assert len(Trajectory(np.array([2.0, 1.0, 1.0]), np.zeros((3, 3)))) == 3


@pytest.mark.parametrize(("stamps", "poses"), [((3,), (2, 3)), ((3,), (3, 2)), ((3, 1), (3, 3)), ((0,), (0,))], ids=str)
def test_arrays_that_do_not_belong_together_are_refused(stamps, poses):
    with pytest.raises(ValueError, match=r"stamps \(N,\) and poses \(N, 3\) must agree in length, got"):
        Trajectory(np.zeros(stamps), np.zeros(poses))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(ValueError, match="stamps and poses must be finite"):
        Trajectory(np.array([0.0]), np.array([[0.0, value, 0.0]]))
    with pytest.raises(ValueError, match="stamps and poses must be finite"):
        Trajectory(np.array([value]), np.zeros((1, 3)))


STAMPS = 1000.0 + 0.2 * np.arange(11)


def arc(speed, rate):
    """Return poses (11, 3) of a robot that drives and turns steadily."""
    times = STAMPS - STAMPS[0]
    return np.column_stack(
        (speed / rate * np.sin(rate * times), speed / rate * (1.0 - np.cos(rate * times)), rate * times)
    )


@pytest.mark.parametrize(("speed", "rate"), [(0.5, 0.3), (-0.4, 0.1), (1.0, -0.8)])
def test_speed_and_turn_rate_of_a_steady_arc(speed, rate):
    poses = arc(speed, rate)
    np.testing.assert_allclose(turn_rates(STAMPS, poses[:, 2]), rate)
    np.testing.assert_allclose(drive_speeds(STAMPS, poses)[1:-1], speed, rtol=0.01)


def test_a_heading_that_crosses_pi_is_no_spin():
    headings = np.remainder(np.linspace(3.0, 3.5, 11) + np.pi, 2.0 * np.pi) - np.pi
    np.testing.assert_allclose(turn_rates(STAMPS, headings), 0.25)


@pytest.mark.parametrize("jump", [0.0, -30.0, -1e6])
def test_speeds_are_unknown_if_the_clock_rests_or_steps_back(jump):
    """At both sides of a step back, and all along where stamps are the same."""
    poses, stamps = arc(0.5, 0.3), STAMPS.copy()
    if jump:
        stamps[5:] += jump
        unknown = [4, 5]
    else:
        stamps[:] = stamps[0]
        unknown = list(range(11))
    known = np.setdiff1d(np.arange(11), unknown)
    rates, speeds = turn_rates(stamps, poses[:, 2]), drive_speeds(stamps, poses)
    np.testing.assert_array_equal(rates[unknown], 0.0)
    np.testing.assert_array_equal(speeds[unknown], 0.0)
    np.testing.assert_allclose(rates[known], 0.3)


def test_no_robot_is_faster_than_robots_are():
    poses = arc(0.5, 0.3) * [1e3, 1e3, 1.0]
    poses[5:, 2] += 1.5
    assert np.abs(drive_speeds(STAMPS, poses)).max() == 5.0
    assert turn_rates(STAMPS, poses[:, 2]).max() == 2.0


def test_where_there_was_no_odometry_the_speed_is_unknown():
    poses = arc(0.5, 0.3)
    poses[:3] = np.nan
    speeds = drive_speeds(STAMPS, poses)
    assert np.isnan(speeds[:4]).all()
    assert np.isfinite(speeds[4:]).all()
