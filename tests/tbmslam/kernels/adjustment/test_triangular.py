import numpy as np
import pytest

from tbmslam.kernels.adjustment.triangular import factorise, solve


@pytest.mark.parametrize("size", [1, 2, 7, 40])
def test_equations_are_solved(generator, size):
    root = generator.normal(size=(size, size))
    matrix, vector = root @ root.T + np.eye(size), generator.normal(size=size)
    upper = factorise(np.triu(matrix))  # the rest is not read
    unit = np.triu(upper) / np.diag(upper)[:, None]
    np.testing.assert_allclose(unit.T @ np.diag(np.diag(upper)) @ unit, matrix, atol=1e-9)
    found = vector.copy()
    solve(upper, found)
    np.testing.assert_allclose(matrix @ found, vector, atol=1e-8)
