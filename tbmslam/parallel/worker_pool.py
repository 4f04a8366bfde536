"""Processes and threads of this machine that share work; processes end with their parent."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import connection, resource_tracker
from types import FrameType
from typing import ParamSpec, Self, TypeVar

from tbmslam.errors import TbmSlamError

_ENDING = (signal.SIGINT, signal.SIGTERM)
_MOST_ON_WINDOWS = 61
"""Windows waits for at most 63 processes and pipes at once; see the manual of `ProcessPoolExecutor`."""


class DeferredInterrupt:
    """A block that defers exceptions of signal handlers until its end.

    Python may run a handler between any two steps of the main thread. If it raises in `threading.Condition.__enter__`,
    the lock stays taken, and threads that wait for it never end. `hurry` is called after the first signal, to end the
    block soon; a second signal is raised immediately. `came` is the deferred exception.
    """

    def __init__(self, hurry: Callable[[], object]) -> None:
        self.came: BaseException | None = None
        self._hurry = hurry
        self._usual: dict[signal.Signals, Callable[[int, FrameType | None], object]] = {}

    def __enter__(self) -> Self:
        """Replace the handlers; only a main thread has any."""
        if threading.current_thread() is threading.main_thread():
            for number in _ENDING:
                usual = signal.getsignal(number)
                if callable(usual):
                    self._usual[number] = usual
                    signal.signal(number, partial(self._heard, usual))
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the handlers, and raise the deferred exception."""
        for number, usual in self._usual.items():
            signal.signal(number, usual)
        self.give_way()

    def give_way(self) -> None:
        """Raise the deferred exception, if there is one."""
        came, self.came = self.came, None
        if came is not None:
            raise came from None

    def _heard(self, usual: Callable[[int, FrameType | None], object], number: int, frame: FrameType | None) -> None:
        if self.came is not None:
            usual(number, frame)
            return
        try:
            usual(number, frame)
        except BaseException as error:  # noqa: BLE001 - raised again at the end of the block
            self.came = error
            self._hurry()


_P = ParamSpec("_P")
_R = TypeVar("_R")


class WorkerDiedError(TbmSlamError):
    """A process ended before its work was done."""

    def __init__(self) -> None:
        super().__init__("a worker process died, perhaps out of memory: run again with fewer --workers")

    def __reduce__(self) -> tuple[type[Self], tuple[()]]:
        """Pickle the error without its message, which `__init__` does not take."""
        return type(self), ()


class WorkerPool(ProcessPoolExecutor):
    """Processes that ignore Ctrl-C: the process that started them receives it and stops them."""

    def __init__(self, workers: int, initializer: Callable[[], object] | None, interrupt: DeferredInterrupt) -> None:
        context = multiprocessing.get_context("spawn")  # threads of compiled code do not survive a fork
        most = _MOST_ON_WINDOWS if sys.platform == "win32" else workers
        super().__init__(min(workers, most), context, partial(_begin, initializer))
        self._interrupt = interrupt

    def submit(self, fn: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
        """Submit work to a process; a new process inherits the blocked signals.

        Raises a `KeyboardInterrupt` if Ctrl-C came before there was a process to stop.
        """
        with interrupts_held():
            self._interrupt.give_way()
            return super().submit(fn, *args, **kwargs)

    def result(self, future: Future[_R]) -> _R:
        """Wait for submitted work, and return its result or raise its error.

        Raises a `WorkerDiedError` if a process died, and a `KeyboardInterrupt` if Ctrl-C stopped them.
        """
        try:
            return future.result()
        except BrokenProcessPool:
            self._interrupt.give_way()
            raise WorkerDiedError from None


@contextmanager
def worker_pool(workers: int, initializer: Callable[[], object] | None = None) -> Iterator[WorkerPool]:
    """Keep processes for a block; if it fails or is interrupted, they are stopped and their work is cancelled.

    The exception of a signal is raised once they are stopped, at the block's end at the latest.
    """
    others = multiprocessing.active_children()

    def stop() -> None:
        for child in multiprocessing.active_children():
            if child not in others:
                child.terminate()  # the pool is then broken and cancels the remaining work

    with DeferredInterrupt(stop) as interrupt, WorkerPool(workers, initializer, interrupt) as pool:
        try:
            yield pool
        except BaseException as error:
            stop()
            if isinstance(error, BrokenProcessPool):
                raise WorkerDiedError from None
            raise


def _begin(initializer: Callable[[], object] | None) -> None:
    """Start a worker, which ends if its parent process has died, and leaves Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Windows cannot block it
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if initializer is not None:
        initializer()


def _end_with_parent() -> None:
    """Wait for the end of the parent process, and then end."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Defer Ctrl-C during a block; a process that starts in it ignores Ctrl-C from the beginning."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # it starts with the first process, and enables Ctrl-C again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_Item = TypeVar("_Item")
_Made = TypeVar("_Made")


def in_threads(call: Callable[[_Item], _Made], items: Sequence[_Item]) -> list[_Made]:
    """Return the result of a call for each item, in their order, on all cores.

    The calls must not write what others read.
    """
    threads = min(len(items), os.cpu_count() or 1)
    if threads < 2:
        return [call(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(call, items))
