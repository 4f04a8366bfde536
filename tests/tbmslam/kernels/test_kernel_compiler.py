import numba
import numpy as np
from numba.core import config

from tbmslam.kernels import kernel, part
from tbmslam.kernels.kernel_compiler import KernelCompiler, Part
from tests.processes import python


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


@part
def halved(numbers):
    return numbers / 2.0


@part
def lowered(numbers, by):
    halves = halved(numbers)
    halves[0] -= by[0]
    return halves


@kernel
def both(numbers, wide):
    return lowered(numbers, (1.0, 2.0))[0], halved(wide)[1]


def test_parts_are_compiled_into_the_kernels_that_call_them():
    if not config.DISABLE_JIT:
        assert isinstance(halved, Part)
    assert both(np.array([4.0, 2.0]), np.array([4.0, 2.0], dtype=np.float32)) == (1.0, 1.0)
    assert lowered(np.array([4.0, 2.0]), (3.0, 2.0)).tolist() == [-1.0, 1.0]  # Python calls it, too
    assert both(np.array([-4.0, 2.0]), np.array([-4.0, 2.0], dtype=np.float32)) == (-3.0, 1.0)


NEWER = """
import numba, numpy as np
numba.version_info = numba.version_info._replace(short=(99, 0))
from tbmslam.kernels import kernel, part

@part
def doubled(numbers):
    return numbers * 2.0

@kernel
def total(numbers):
    return doubled(numbers).sum() + sum([one for one in range(3)])

print(total(np.ones(2)), doubled(np.ones(1)))
"""


def test_a_newer_numba_compiles_kernels_its_own_way(tmp_path):
    (tmp_path / "newer.py").write_text(NEWER, encoding="utf-8")
    done = python(tmp_path / "newer.py")
    assert done.stdout.split() == ["7.0", "[2.]"], done.stderr
