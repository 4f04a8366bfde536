import numba
import numpy as np
import pytest
from numba.core import config

from tbmslam.kernels import remembered_types
from tbmslam.kernels.kernel_compiler import KernelCompiler

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")


def total(numbers):
    return np.nansum(numbers) * 2.0


def compiled_total(fastmath):
    """Return the code of a function that is compiled anew."""
    compiled = numba.njit(total, fastmath=fastmath, pipeline_class=KernelCompiler)
    assert compiled(np.arange(4.0)) == 12.0
    return compiled.inspect_llvm(compiled.signatures[0])


def test_each_kind_of_operands_is_typed_once(monkeypatch):
    monkeypatch.setattr(remembered_types, "_signatures", {})
    compiled_total(set())
    before = len(remembered_types._signatures)
    assert before > 0
    compiled_total(set())
    assert len(remembered_types._signatures) == before


def test_remembered_functions_keep_the_flags_of_their_kernel():
    assert "fadd reassoc" not in compiled_total(set())
    assert "fadd reassoc" in compiled_total({"reassoc"})
    assert "fadd reassoc" not in compiled_total(set())
