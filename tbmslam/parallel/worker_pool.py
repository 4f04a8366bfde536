"""Processes of this machine that share work, and end with the one that started them."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import connection, resource_tracker
from typing import ParamSpec, TypeVar

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.deferred_interrupt import DeferredInterrupt

_P = ParamSpec("_P")
_R = TypeVar("_R")


class WorkerDiedError(TbmSlamError):
    """A process that had work to do ended before it was done."""

    def __init__(self) -> None:
        super().__init__("a worker process died: memory may have run out; run again with fewer --workers")


class WorkerPool(ProcessPoolExecutor):
    """Processes that do not hear Ctrl-C: who started them does, and stops them.

    Parameters
    ----------
    workers
        How many there are at the most.
    initializer
        What each does first.
    interrupt
        What tells whether they were stopped.
    """

    def __init__(self, workers: int, initializer: Callable[[], object] | None, interrupt: DeferredInterrupt) -> None:
        context = multiprocessing.get_context("spawn")  # threads of compiled code do not survive a fork
        super().__init__(workers, context, partial(_begin, initializer))
        self._interrupt = interrupt

    def submit(self, fn: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
        """Give work to a process, which may begin for it and then takes over what is held.

        Raises
        ------
        KeyboardInterrupt
            Ctrl-C came before there was a process to stop.
        """
        with interrupts_held():
            self._interrupt.give_way()
            return super().submit(fn, *args, **kwargs)

    def result(self, future: Future[_R]) -> _R:
        """Wait for what was given to a process, and return what it made or raise what it raised.

        Raises
        ------
        WorkerDiedError
            A process died.
        KeyboardInterrupt
            Ctrl-C stopped them.
        """
        try:
            return future.result()
        except BrokenProcessPool:
            self._interrupt.give_way()
            raise WorkerDiedError from None


@contextmanager
def worker_pool(workers: int, initializer: Callable[[], object] | None = None) -> Iterator[WorkerPool]:
    """Keep processes for a block; where it fails or is interrupted, they are stopped and their work is dropped.

    What a signal raises is raised when they are, by the block's end at the latest.

    Raises
    ------
    WorkerDiedError
        A process died.
    """
    others = multiprocessing.active_children()

    def stop() -> None:
        for child in multiprocessing.active_children():
            if child not in others:
                child.terminate()  # what waits for it is dropped by the pool, which then is broken

    with DeferredInterrupt(stop) as interrupt, WorkerPool(workers, initializer, interrupt) as pool:
        try:
            yield pool
        except BaseException as error:
            stop()
            if isinstance(error, BrokenProcessPool):
                raise WorkerDiedError from None
            raise


def _begin(initializer: Callable[[], object] | None) -> None:
    """Begin as a worker, which waits for work for ever and so has to see for itself when nobody is left to give any."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if initializer is not None:
        initializer()


def _end_with_parent() -> None:
    """Wait until the process that began this one has ended, if it was killed without a chance to say so; then end."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Keep Ctrl-C waiting for a block; a process that begins in it never hears it, not even while it begins."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # it begins with the first process, and lets Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
