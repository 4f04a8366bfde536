from tests.processes import python

CODE = """
import sys

import numba
import numpy as np

from tbmslam.kernels.rays.hits import any_negative

any_negative(np.zeros(3))
print("scipy.linalg" in sys.modules)
print(numba.njit(lambda a, b: np.dot(a, b))(np.eye(2), np.eye(2)).trace())
from scipy import linalg
print(linalg.det(np.eye(2)))
"""


def test_kernels_load_no_scipy_and_leave_it_to_others():
    assert python("-c", CODE).stdout.split() == ["False", "2.0", "1.0"]
