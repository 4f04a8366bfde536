"""Numba's compiler without the work that kernels do not need.

Numba's default pipeline has 27 passes for all of Python: closures, comprehensions, context managers, branches on types
and on None, and object mode. Most of them change nothing in a kernel, but each one analyses the whole function again.

Numba also optimises each function that a kernel calls, makes machine code of it, wraps it for calls from Python and
caches it, and then does all of that again with the kernel that it is linked into. `Part` leaves that to the kernel.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

from numba.core import typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.rewrites.registry import RewriteRegistry
from numba.core.rewrites.static_binop import DetectStaticBinops
from numba.core.rewrites.static_getitem import RewriteConstGetitems

from tbmslam.kernels.remembered_types import TypeInference

_REWRITES = RewriteRegistry()
for _rewrite in (RewriteConstGetitems, DetectStaticBinops):  # constant indices of tuples and constant exponents
    _REWRITES.register("before-inference")(_rewrite)


@register_pass(mutates_CFG=True, analysis_only=False)
class _Rewrites(untyped_passes.GenericRewrites):
    """Two of numba's six rewrites before the types are inferred."""

    _name = "kernel_rewrites"

    def run_pass(self, state: Any) -> bool:
        """Rewrite a function."""
        _REWRITES.apply("before-inference", state)
        return True


_PASSES: tuple[Any, ...] = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    _Rewrites,
    untyped_passes.ReconstructSSA,
    TypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.IRLegalization,
    typed_passes.AnnotateTypes,
    typed_passes.NativeLowering,
    typed_passes.NoPythonBackend,
)
"""The passes that kernels need, in numba's order. A comprehension in a kernel does not compile, and an expression of
arrays is a loop for each of its operations."""


class KernelCompiler(CompilerBase):
    """Compiles a function by `_PASSES`; see "Customizing the compiler" in numba's manual."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes."""
        return [_manager("kernel", _PASSES)]


def _manager(name: str, passes: tuple[Any, ...]) -> PassManager:
    manager = PassManager(name)
    for each in passes:
        manager.add_pass(each, each.__name__)
    manager.finalize()
    return manager


class _LinkedLibrary(JITCodeLibrary):
    """Code that is neither optimised nor made executable before it is linked into a kernel."""

    def finalize(self) -> None:
        """Link what this code calls."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)  # noqa: SLF001
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(typed_passes.NativeLowering):
    """Numba's lowering into a `_LinkedLibrary`."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        """Write the function in LLVM's language, for kernels that call it."""
        library: Any = _LinkedLibrary  # numba has no types
        lower: Any = super().run_pass
        state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
        # Set here, since numba compiles its own functions again for kernels with other options.
        state.flags.no_compile = state.flags.no_cpython_wrapper = True
        lower(state)
        state.library.finalize()
        identity = object().__reduce__  # no one calls it: numba wants an own built-in method for each function
        state.cr = state.cr._replace(cfunc=identity)
        state.targetctx.insert_user_function(identity, state.cr.fndesc, [state.library])
        return True


class _PartCompiler(CompilerBase):
    """Compiles a part of kernels."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes."""
        lowering = typed_passes.NativeLowering
        return [_manager("part", tuple(_PartLowering if each is lowering else each for each in _PASSES))]


class Part(CPUDispatcher):
    """A function that is compiled into each kernel that calls it; from Python it is called as a kernel of its own."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], kernel: Callable[..., Any]) -> None:
        options = {"nopython": True, "boundscheck": None, **options}
        super().__init__(function, targetoptions=options, pipeline_class=_PartCompiler)
        self._as_kernel = cache(lambda: kernel(function))

    def __call__(self, *arguments: object) -> Any:
        """Call it from Python, as tests do."""
        return self._as_kernel()(*arguments)
