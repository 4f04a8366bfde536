"""Modules that a program loads and keeps."""

import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

INTERRUPTED = 130
"""Exit code of a program that Ctrl-C ended, as shells tell it: 128 and the signal's number."""


@contextmanager
def loading(interrupted: str = "") -> Iterator[None]:
    """Load modules in a block, and never look for garbage in what they are made of.

    Compiled code brings hundreds of thousands of objects that live as long as the program; to search them again and
    again, while they come and later on, takes longer than to read a drive of a quarter of an hour.

    Parameters
    ----------
    interrupted
        What is said where Ctrl-C comes meanwhile, which then ends the program at once: libraries that hear it while
        they begin make other errors of it.
    """
    known, was_enabled = len(sys.modules), gc.isenabled()
    heard = signal.getsignal(signal.SIGINT)
    is_ours = bool(interrupted) and heard is signal.default_int_handler and _is_main_thread()
    gc.disable()
    try:
        if is_ours:
            signal.signal(signal.SIGINT, partial(_end, interrupted))
        yield
    finally:
        if is_ours:
            signal.signal(signal.SIGINT, heard)
        if len(sys.modules) > known:
            gc.freeze()
        if was_enabled:
            gc.enable()


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _end(line: str, *_: object) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
    os._exit(INTERRUPTED)
