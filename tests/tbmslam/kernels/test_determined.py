import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbmslam.kernels.determined import determined_shares


@given(
    arrays(np.float64, (3, 3), elements=st.floats(-30.0, 30.0)), arrays(np.float64, 3, elements=st.floats(0.01, 1.0))
)
def test_shares_are_the_diagonal_of_a_gain(root, deviations):
    information = root.T @ root
    gain = np.linalg.solve(information + np.diag(deviations**-2.0), information)
    np.testing.assert_allclose(determined_shares(information, deviations), np.diag(gain), atol=1e-6)


def test_nothing_measured_determines_nothing():
    assert determined_shares(np.zeros((3, 3)), np.array([0.01, 0.01, 0.005])) == (0.0, 0.0, 0.0)
