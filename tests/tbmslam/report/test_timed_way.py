import numpy as np
import pytest

from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.report.timed_way import timed_ways


def drive(stamps, poses):
    return Drive("r", Trajectory(np.asarray(stamps, float), np.asarray(poses, float)), Keyframes.from_scans([], [], []))


def stop_and_go():
    """Ten seconds ahead at 1 m/s, ten at rest, a half turn in five, at 20 Hz."""
    stamps = 100.0 + 0.05 * np.arange(501)
    since = stamps - 100.0
    poses = np.column_stack((np.minimum(since, 10.0), np.zeros(501), np.clip((since - 20.0) / 5.0, 0.0, 1.0) * np.pi))
    return drive(stamps, poses)


def test_few_poses_tell_to_a_step_where_the_robot_was_at_every_time():
    one = stop_and_go()
    (way,) = timed_ways([one], [(1, 2, 3)])
    assert len(way.times) < 300
    assert (way.times[0], way.times[-1]) == (0.0, pytest.approx(25.0))
    since = one.trajectory.stamps - 100.0
    for column, tolerance in ((0, 0.1), (2, 0.2)):
        told = np.interp(since, way.times, way.poses[:, column])
        np.testing.assert_allclose(told, one.trajectory.poses[:, column], atol=tolerance)


def test_long_drives_and_many_of_them_stay_small():
    stamps = np.arange(20_000.0)
    far = drive(stamps, np.column_stack((stamps, stamps, np.zeros_like(stamps))))
    (way,) = timed_ways([far], [(0, 0, 0)])
    assert 1000 <= len(way.times) <= 2002
    many = timed_ways([far] * 200, [(0, 0, 0)] * 200)
    assert max(len(one.times) for one in many) <= 102


def test_where_the_clock_stepped_back_scans_are_spread_evenly():
    poses = np.column_stack((np.arange(5.0), np.zeros(5), np.zeros(5)))
    (way,) = timed_ways([drive([10.0, 11.0, 9.0, 12.0, 13.0], poses)], [(0, 0, 0)])
    np.testing.assert_allclose(way.times, [0.0, 1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(way.poses[:, 0], np.arange(5.0))


def test_a_drive_of_no_time_has_no_slider():
    assert timed_ways([drive([], np.zeros((0, 3))), drive([1.0, 1.0], np.zeros((2, 3)))], [(0, 0, 0)] * 2) == ()


def test_rows_are_tenths_of_a_second_centimetres_and_degrees():
    (way,) = timed_ways([drive([5.0, 7.54], [[0.0, 0.0, 0.0], [1.234, -2.0, 1.5 * np.pi]])], [(1, 2, 3)])
    assert way.as_json() == {"label": "r", "colour": "rgb(1, 2, 3)", "rows": [[0, 0, 0, 0], [25, 123, -200, -90]]}
