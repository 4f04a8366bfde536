"""Calls in new processes, for measurements of memory and time without influence of earlier calls."""

import contextlib
import math
import multiprocessing
import sys
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Generic, ParamSpec, TypeVar, cast

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.worker_pool import interrupts_held

_P = ParamSpec("_P")
_R = TypeVar("_R")


class MeasurementError(TbmSlamError):
    """A measured call failed."""


class FreshProcess(Generic[_R]):
    """A running call of a module's function in a new Python process; arguments and result are pickled."""

    def __init__(self, call: Callable[_P, _R], *args: _P.args, **keywords: _P.kwargs) -> None:
        context = multiprocessing.get_context("spawn")
        self.answered, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_answer, args=(theirs, call, args, keywords))
        with interrupts_held():  # the parent handles Ctrl-C
            self._process.start()
        theirs.close()

    def result(self) -> _R:
        """Wait for the call and return its result."""
        try:
            is_good, answer = self.answered.recv()
        except EOFError:
            self._process.join()
            raise MeasurementError(
                f"the process died (exit code {self._process.exitcode}): memory may have run out; "
                "see its messages above"
            ) from None
        except BaseException:
            self._process.terminate()
            raise
        finally:
            self._process.join()
            self.answered.close()
        if not is_good:
            raise MeasurementError(str(answer))
        return cast("_R", answer)

    def stop(self) -> None:
        """Terminate the call."""
        self._process.terminate()
        self._process.join()
        self.answered.close()


def in_fresh_process(call: Callable[_P, _R], *args: _P.args, **keywords: _P.kwargs) -> _R:
    """Return the result of a call in a new Python process; see `FreshProcess`."""
    return FreshProcess(call, *args, **keywords).result()


def in_fresh_processes(
    call: Callable[..., _R], arguments: Iterable[tuple[object, ...]], jobs: int
) -> Iterator[tuple[int, _R | MeasurementError]]:
    """Make one call for each tuple of arguments, each in its own process and `jobs` at a time.

    Yields the number of each call and its result, or its error, in the order of their ends.
    """
    waiting = enumerate(arguments)
    running: dict[object, tuple[int, FreshProcess[_R]]] = {}
    try:
        while True:
            for number, args in islice(waiting, jobs - len(running)):
                process = FreshProcess(call, *args)
                running[process.answered] = number, process
            if not running:
                return
            for answered in wait([process.answered for _, process in running.values()]):
                number, process = running.pop(answered)
                try:
                    answer: _R | MeasurementError = process.result()
                except MeasurementError as error:
                    answer = error
                yield number, answer
    finally:
        for _, process in running.values():
            process.stop()


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


def _answer(
    pipe: Connection, call: Callable[..., object], args: tuple[object, ...], keywords: dict[str, object]
) -> None:
    try:
        pipe.send((True, call(*args, **keywords)))
    except TbmSlamError as error:
        pipe.send((False, str(error)))
    finally:
        pipe.close()
