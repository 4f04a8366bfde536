import numba
import numpy as np

from tbmslam.kernels import kernel_compiler
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


def total(numbers):
    return np.nansum(numbers) * 2.0


def compiled_total(fastmath):
    """Return the code of a function that is compiled anew."""
    compiled = numba.njit(total, fastmath=fastmath, pipeline_class=KernelCompiler)
    assert compiled(np.arange(4.0)) == 12.0
    return compiled.inspect_llvm(compiled.signatures[0])


def test_each_kind_of_operands_is_typed_once():
    compiled_total(set())
    before = len(kernel_compiler._signatures)
    compiled_total(set())
    assert len(kernel_compiler._signatures) == before


def test_remembered_functions_keep_the_flags_of_their_kernel():
    assert "fadd reassoc" not in compiled_total(set())
    assert "fadd reassoc" in compiled_total({"reassoc"})
    assert "fadd reassoc" not in compiled_total(set())
