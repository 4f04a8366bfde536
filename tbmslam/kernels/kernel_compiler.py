"""Numba's compiler without the passes that kernels do not need.

Numba's default pipeline has 27 passes for all of Python: closures, comprehensions, context managers, branches on types
and on None, and object mode. Most of them change nothing in a kernel, but each one analyses the whole function again.
"""

from typing import Any

from numba.core import typed_passes, untyped_passes
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager

_PASSES: tuple[Any, ...] = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.GenericRewrites,  # constant indices of tuples
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.NopythonRewrites,  # one loop for an expression of arrays
    typed_passes.IRLegalization,
    typed_passes.AnnotateTypes,
    typed_passes.NativeLowering,
    typed_passes.NoPythonBackend,
)
"""The passes that kernels need, in numba's order. A comprehension in a kernel does not compile."""


class KernelCompiler(CompilerBase):
    """Compiles a function by `_PASSES`; see "Customizing the compiler" in numba's manual."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes."""
        manager = PassManager("kernel")
        for each in _PASSES:
            manager.add_pass(each, each.__name__)
        manager.finalize()
        return [manager]
