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

_P = ParamSpec("_P")
_R = TypeVar("_R")


class WorkerDiedError(TbmSlamError):
    """A process that had work to do ended before it was done."""


class WorkerPool(ProcessPoolExecutor):
    """Processes that do not hear Ctrl-C: who started them does, and stops them."""

    def submit(self, fn: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
        """Give work to a process, which may begin for it and then takes over what is held."""
        with interrupts_held():
            return super().submit(fn, *args, **kwargs)


@contextmanager
def worker_pool(workers: int, initializer: Callable[[], object] | None = None) -> Iterator[WorkerPool]:
    """Keep processes for a block; where it fails or is interrupted, they are stopped and their work is dropped.

    Raises
    ------
    WorkerDiedError
        A process died, which the block did not catch as `BrokenProcessPool`.
    """
    context = multiprocessing.get_context("spawn")  # threads of compiled code do not survive a fork
    with WorkerPool(workers, context, partial(_begin, initializer)) as pool:
        before = multiprocessing.active_children()
        try:
            yield pool
        except BaseException as error:
            for child in multiprocessing.active_children():
                if child not in before:
                    child.terminate()  # what waits for it is dropped by the pool, which then is broken
            if isinstance(error, BrokenProcessPool):
                raise WorkerDiedError(
                    "a worker process died: memory may have run out; run again with fewer --workers"
                ) from None
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
