"""Calls in new processes, for measurements of memory and time without influence of earlier calls."""

import contextlib
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.worker_pool import worker_pool

_P = ParamSpec("_P")
_R = TypeVar("_R")


def in_fresh_process(call: Callable[_P, _R], *args: _P.args, **keywords: _P.kwargs) -> _R:
    """Return the result of a module's function, called in a new Python process; arguments and result are pickled.

    Any error but a `MemoryError` becomes a `TbmSlamError`, so that a long benchmark can report it and go on.
    """
    try:
        with worker_pool(1) as pool:
            return pool.result(pool.submit(call, *args, **keywords))
    except (TbmSlamError, MemoryError):
        raise
    except Exception as error:
        raise TbmSlamError(f"{type(error).__name__}: {error}") from error


def peak_memory_mb() -> float:
    """Return the peak memory of this process [MB]; NaN if the system does not report it."""
    # On Linux getrusage may report the peak of the parent process.
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:  # Windows
        return math.nan
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def forget_peak_memory() -> None:
    """Reset the peak of `peak_memory_mb`, if the system can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
