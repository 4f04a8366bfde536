import numba
import numpy as np

from tbmslam.kernels.kernel_compiler import KernelCompiler


def function(numbers, pose, wide):
    total, last = np.zeros(2), 0
    for i in range(len(numbers)):
        if numbers[i] > pose[2]:
            continue
        total[i % 2] += numbers[i] * pose[0]
        last = i
    while last < wide.shape[1]:
        last += 1
    return (total + wide[0, :2]).sum(), pose[1], last


def test_compiled_code_does_what_python_does():
    compiled = numba.njit(function, pipeline_class=KernelCompiler)
    arguments = np.array([1.0, 5.0, 2.0]), (2.0, 7, 3.0), np.ones((2, 4), dtype=np.float32)
    assert compiled(*arguments) == function(*arguments) == (8.0, 7, 4)
