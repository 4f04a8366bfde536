import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbmslam.evaluation.trajectory_alignment import TrajectoryAlignmentError, align_trajectories, fit_rigid
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


motions = st.builds(SE2, st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi - 1e-9))


@settings(deadline=None)
@given(motion=motions, seed=st.integers(0, 1000), scale=st.floats(0.5, 2.0))
def test_the_fit_finds_the_motion_and_the_scale(motion, seed, scale):
    source = np.random.default_rng(seed).uniform(-5.0, 5.0, size=(7, 2))
    centred = source - source.mean(axis=0)
    found, found_scale = fit_rigid(motion.apply(scale * centred), centred)
    assert found_scale == pytest.approx(scale)
    np.testing.assert_allclose((motion.inverse() @ found).log(), 0.0, atol=1e-6)


def test_the_fit_never_mirrors():
    source = np.array([(0.0, 0.0), (2.0, 0.0), (0.0, 1.0)])
    found, _ = fit_rigid(source * (1.0, -1.0), source)
    assert np.linalg.det(found.matrix()[:2, :2]) == pytest.approx(1.0)


def test_coincident_points_have_no_scale():
    _, scale = fit_rigid(np.ones((3, 2)), np.zeros((3, 2)))
    assert math.isnan(scale)
