"""The only compiled code: plain functions on plain arrays, and the rules they share.

A kernel validates nothing, raises nothing and does no I/O; the module above it does. It never uses fastmath (which
breaks ``isnan``) nor parallel float reductions (which change the result from run to run). Out-of-range indices are
silent in compiled code: callers make the grid large enough first, and CI runs the kernel tests once more with
``NUMBA_BOUNDSCHECK=1``.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt
from numba.core import config

_settings: Any = config  # numba sets the attributes of this module while it loads

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Pose = tuple[float, float, float]
"""x [m], y [m], theta [rad]; an SE2 is one."""

Function = TypeVar("Function", bound=Callable[..., object])


def _cache_directory() -> str | None:
    """Name the cache by the sources and the bounds-check flag; None where there is no place for one.

    Numba's own cache looks at one file at a time, so it runs stale code when a callee in another file changed, and it
    ignores ``NUMBA_BOUNDSCHECK`` once something is cached.
    """
    digest = hashlib.sha256(os.environ.get("NUMBA_BOUNDSCHECK", "").encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    user_cache = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    root = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(user_cache) / "tbmslam")
    try:
        root = root.expanduser()
    except RuntimeError:  # a user without a home, as in some containers
        return None
    return str(root / digest.hexdigest()[:16])


def _writable(directory: str) -> bool:
    try:
        Path(directory).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            return True
    except OSError:
        return False


_CACHE_DIRECTORY = _cache_directory()
_CACHE = _CACHE_DIRECTORY is not None and _writable(_CACHE_DIRECTORY)


def kernel(function: Function) -> Function:
    """Compile a function with the project's options, cached on disk where a writable place exists."""
    if not _CACHE:
        return cast("Function", numba.njit(nogil=True, error_model="numpy")(function))
    previous = _settings.CACHE_DIR
    _settings.CACHE_DIR = _CACHE_DIRECTORY
    try:
        return cast("Function", numba.njit(nogil=True, error_model="numpy", cache=True)(function))
    finally:
        _settings.CACHE_DIR = previous
