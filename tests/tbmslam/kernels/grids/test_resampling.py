import numpy as np
import pytest

from tbmslam.kernels.grids.resampling import resample

VACUOUS = (0.0, 0.0, 0.0, 1.0)


def beliefs(rows, cols):
    return np.random.default_rng(7).dirichlet(np.ones(4), size=(rows, cols)).astype(np.float32)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_places_on_no_side_of_the_old_grid_are_read(samples):
    masses, resampled = beliefs(3, 4), np.full((9, 10, 4), np.nan, dtype=np.float32)
    resample(masses, (0, 0), (3, 4), np.array([1.0, 0.0, -3.0]), np.array([0.0, 1.0, -3.0]), samples, (0, 0), resampled)
    np.testing.assert_allclose(resampled[3:6, 3:7], masses, atol=1e-6)
    outside = np.ones((9, 10), dtype=bool)
    outside[3:6, 3:7] = False
    assert np.all(resampled[outside] == VACUOUS)


def test_rows_and_columns_may_change_places():
    masses, resampled = beliefs(3, 4), np.empty((4, 3, 4), dtype=np.float32)
    resample(masses, (0, 0), (3, 4), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), 1, (0, 0), resampled)
    np.testing.assert_array_equal(resampled, masses.transpose(1, 0, 2))
