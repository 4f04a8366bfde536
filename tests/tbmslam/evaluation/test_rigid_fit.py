import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbmslam.evaluation.rigid_fit import fit_rigid
from tbmslam.geometry.se2 import SE2

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
