import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.keyframe_indices import indices_by_stamp


def way(stamps):
    """Return a drive on which no two poses are alike."""
    return Trajectory(np.array(stamps, dtype=np.float64), np.arange(3.0 * len(stamps)).reshape(-1, 3))


def of(trajectory, indices, moved=0.0):
    return indices_by_stamp(trajectory, trajectory.stamps[indices], trajectory.poses[indices] + moved).tolist()


@given(st.lists(st.sampled_from([0.1, 0.1, 0.1, -0.2, -5.0, -30.0, 0.0, 40.0]), min_size=5, max_size=200), st.data())
def test_keyframes_are_found_however_stamps_step(steps, data):
    trajectory = way(np.round(np.cumsum(steps), 1))
    chosen = data.draw(st.sets(st.integers(0, len(steps) - 1), min_size=1))
    assert of(trajectory, sorted(chosen)) == sorted(chosen)


def test_of_a_drive_that_was_moved_the_first_coming_pose_of_a_stamp_is_taken():
    trajectory = way([0.0, 1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 4.0])
    assert of(trajectory, [0, 2, 4, 6, 7], moved=0.5) == [0, 2, 4, 5 + 1, 7]
    assert of(trajectory, [5], moved=0.5) == [2]


def test_where_no_pose_has_the_stamp_the_nearest_coming_one_is_taken():
    trajectory = way([0.0, 1.0, 2.0, 0.5, 1.5, 2.5])
    stamps = np.array([0.9, 1.8, 1.4, 9.0])
    assert indices_by_stamp(trajectory, stamps, np.zeros((4, 3))).tolist() == [1, 2, 4, 5]


def test_indices_rise_whatever_the_stamps():
    trajectory, stamps = way([5.0] * 4), np.array([9.0, 5.0, -9.0, 5.0])
    assert indices_by_stamp(trajectory, stamps, np.zeros((4, 3))).tolist() == [0, 1, 2, 3]


def test_more_keyframes_than_poses_are_refused():
    with pytest.raises(ValueError, match="3 keyframes cannot be among the 2 poses of the trajectory"):
        indices_by_stamp(way([1.0, 2.0]), np.ones(3), np.zeros((3, 3)))
    assert indices_by_stamp(way([]), np.ones(3), np.zeros((3, 3))).tolist() == [0, 1, 2]
