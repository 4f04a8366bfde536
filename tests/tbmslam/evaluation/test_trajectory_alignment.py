import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.evaluation.trajectory_alignment import TrajectoryAlignmentError, align_trajectories
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory


def drive(seed, count=50):
    generator = np.random.default_rng(seed)
    poses = np.column_stack((generator.uniform(-5, 5, (count, 2)), generator.uniform(-3, 3, count)))
    return Trajectory(np.arange(count) * 0.1, poses)


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-3.1, 3.1), st.integers(0, 99))
def test_a_moved_copy_is_found(x, y, theta, seed):
    reference = drive(seed)
    T_reference_estimate = SE2(x, y, theta)
    result = align_trajectories(reference, reference.transformed(T_reference_estimate.inverse()))
    assert result.T_reference_estimate == pytest.approx(T_reference_estimate, abs=1e-6)
    assert result.ate_m < 1e-9


def test_ate_is_the_root_mean_square():
    reference = Trajectory(np.arange(4.0), np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float))
    shifted = reference.poses.copy()
    shifted[[0, 3], 0] += 0.1
    shifted[[1, 2], 0] -= 0.1
    assert align_trajectories(reference, Trajectory(reference.stamps, shifted)).ate_m == pytest.approx(0.1, rel=1e-2)


def test_unrelated_clocks_are_refused():
    reference = drive(1)
    late = Trajectory(reference.stamps + 82.2, reference.poses)
    with pytest.raises(TrajectoryAlignmentError, match=r"only 0 of 50 poses have a partner within 0.01 s"):
        align_trajectories(reference, late)
