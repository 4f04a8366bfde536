"""The only compiled code: plain functions on plain arrays, and the rules they share.

A kernel validates nothing, raises nothing and does no I/O; the module above it does. It never uses all of fastmath
(which breaks ``isnan``) nor parallel float reductions (which change the result from run to run). Out-of-range indices
are silent in compiled code: callers make the grid large enough first, and CI runs the kernel tests once more with
``NUMBA_BOUNDSCHECK=1``.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt
from numba.core import config

from tbmslam.kernels.cache_folders import folder_of

_settings: Any = config  # numba sets the attributes of this module while it loads
_njit: Any = numba.njit  # its type does not name all options

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Pose = tuple[float, float, float]
"""x [m], y [m], theta [rad]; an SE2 is one."""

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
    """Compile a function with the project's options, cached on disk where a writable place exists."""
    return _compiled(function, set())


def summing_kernel(function: Function) -> Function:
    """Compile a function as `kernel` does, its sums taken in the order that vector instructions are fastest in.

    The order is the same in every run on one kind of processor; not-a-number stays what it is.
    """
    return _compiled(function, {"reassoc"})


def _compiled(function: Function, fastmath: set[str]) -> Function:
    folder = folder_of(function.__code__.co_filename)
    previous = _settings.CACHE_DIR, getattr(_settings, "CACHE_LOCATOR_CLASSES", "")
    if folder is not None:
        _settings.CACHE_DIR = str(folder)
        # Numba before 0.62 does not know this, and compiles once for each installation.
        _settings.CACHE_LOCATOR_CLASSES = f"{__name__}.cache_locator.ContentLocator"
    # Nothing calls a kernel by its address: the wrapper for that is not compiled.
    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "fastmath": fastmath}
    try:
        return cast("Function", _njit(**options, cache=folder is not None)(function))
    finally:
        _settings.CACHE_DIR, _settings.CACHE_LOCATOR_CLASSES = previous
