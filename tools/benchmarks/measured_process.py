"""Calls in a fresh process of their own, so that memory and caches are those of the call alone."""

import contextlib
import multiprocessing
import resource
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

from tbmslam.errors import TbmSlamError
from tbmslam.worker_pool import interrupts_held

_P = ParamSpec("_P")
_R = TypeVar("_R")


class MeasurementError(TbmSlamError):
    """What was to be measured did not come to its end."""


def in_fresh_process(call: Callable[_P, _R], *args: _P.args, **keywords: _P.kwargs) -> _R:
    """Make a call in a new Python process and return what it returns.

    Parameters
    ----------
    call
        A module's function; it, its arguments and its result are pickled.

    Raises
    ------
    MeasurementError
        The call raised a `TbmSlamError`, whose message this repeats, or the process died.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(theirs, call, args, keywords))
    with interrupts_held():  # who waits for it hears Ctrl-C
        process.start()
    theirs.close()
    try:
        is_good, answer = ours.recv()
    except EOFError:
        process.join()
        raise MeasurementError(
            f"the process died (exit code {process.exitcode}): memory may have run out; see its messages above"
        ) from None
    except BaseException:
        process.terminate()
        raise
    finally:
        process.join()
        ours.close()
    if not is_good:
        raise MeasurementError(str(answer))
    return cast("_R", answer)


def peak_memory_mb() -> float:
    """Return the most memory this process has held so far [MB]."""
    # Where there is /proc: getrusage may report the parent's peak, taken over when the process began.
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def forget_peak_memory() -> None:
    """Let `peak_memory_mb` tell of what comes from here on, where the system can; else it tells of all."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def _answer(
    pipe: Connection, call: Callable[..., object], args: tuple[object, ...], keywords: dict[str, object]
) -> None:
    try:
        pipe.send((True, call(*args, **keywords)))
    except TbmSlamError as error:
        pipe.send((False, str(error)))
    finally:
        pipe.close()
