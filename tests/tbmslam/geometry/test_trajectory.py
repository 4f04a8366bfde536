import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory


def square():
    return Trajectory(
        np.array([10.0, 11.0, 12.0, 13.0]),
        np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 1.5], [2.0, 3.0, 3.0], [0.0, 3.0, -2.0]]),
    )


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
