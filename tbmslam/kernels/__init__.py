"""The only compiled code: plain functions on plain arrays, and the rules they share.

A kernel neither validates nor raises, and does no I/O; its callers do. It does not use the whole of fastmath, which
breaks ``isnan``, nor parallel float reductions, which change the result from run to run. Compiled code does not detect
indices out of range. Callers therefore enlarge grids first, and CI repeats the kernel tests with
``NUMBA_BOUNDSCHECK=1``.
"""

import os
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

# Numba words thousands of errors while it tries types; where `colorama` is installed, colours take a second of that.
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

import numba
from numba.core import config

from tbmslam.kernels.cache_folders import folder_of

_settings: Any = config  # numba sets the attributes of this module while it loads
_njit: Any = numba.njit  # its type does not name all options
_NEWEST = 0, 68
"""The newest numba that `kernel_compiler` was tested with. It changes the compiler, so newer versions compile kernels
their own way, which takes longer."""
_compiler: Any = None
if numba.version_info.short <= _NEWEST:
    _compiler = import_module("tbmslam.kernels.kernel_compiler")

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Pose = tuple[float, float, float]
"""x [m], y [m], theta [rad], such as an `SE2`."""

Function = TypeVar("Function", bound=Callable[..., object])


def _load_array_functions() -> None:
    """Load numba's functions of arrays, which each kernel needs, without SciPy, which takes 0.1 s to load.

    While they load they ask whether SciPy's BLAS can be imported. Without it one inner product runs as a plain loop; no
    kernel uses it. Matrix products look for the BLAS again when they are compiled.
    """
    if "scipy.linalg" in sys.modules:
        return
    sys.modules["scipy.linalg"] = cast("Any", None)  # an import of it fails
    try:
        import_module("numba.np.arraymath")
    finally:
        del sys.modules["scipy.linalg"]


_load_array_functions()


def kernel(function: Function) -> Function:
    """Compile a function with the project's options, and cache it on disk if a folder is writable."""
    return _compiled(function, set())


def summing_kernel(function: Function) -> Function:
    """Compile a function as `kernel` does, with its sums reordered for vector instructions.

    The order is the same in every run on one kind of processor. Not-a-number is preserved.
    """
    return _compiled(function, {"reassoc"})


def part(function: Function) -> Function:
    """Compile a function into each kernel that calls it, which takes half the time of a `kernel`.

    Tests may call it as a kernel. Whatever the programs call from Python is better a `kernel`, which is compiled once.
    """
    return _linked(function, kernel, set())


def summing_part(function: Function) -> Function:
    """Compile a function as `part` does, with its sums reordered as those of a `summing_kernel`."""
    return _linked(function, summing_kernel, {"reassoc"})


def _linked(function: Function, compiler: Callable[[Function], Function], fastmath: set[str]) -> Function:
    if _settings.DISABLE_JIT or _compiler is None:
        return compiler(function)
    return cast("Function", _compiler.Part(function, _options(fastmath), compiler))


def _compiled(function: Function, fastmath: set[str]) -> Function:
    folder = folder_of(function.__code__.co_filename)
    previous = _settings.CACHE_DIR, getattr(_settings, "CACHE_LOCATOR_CLASSES", "")
    if folder is not None:
        _settings.CACHE_DIR = str(folder)
        # Numba before 0.62 ignores this option, and compiles once for each installation.
        _settings.CACHE_LOCATOR_CLASSES = f"{__name__}.cache_locator.ContentLocator"
    options = {**_options(fastmath), "cache": folder is not None}
    if _compiler is not None:
        options["pipeline_class"] = _compiler.KernelCompiler
    try:
        return cast("Function", _njit(**options)(function))
    finally:
        _settings.CACHE_DIR, _settings.CACHE_LOCATOR_CLASSES = previous


def _options(fastmath: set[str]) -> dict[str, Any]:
    # No code calls a kernel by its address, so the wrapper for such calls is not compiled.
    return {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "fastmath": fastmath}
