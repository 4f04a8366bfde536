"""Modules that a program loads and keeps."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def loading() -> Iterator[None]:
    """Load modules in a block, and never look for garbage in what they are made of.

    Compiled code brings hundreds of thousands of objects that live as long as the program; to search them again and
    again, while they come and later on, takes longer than to read a drive of a quarter of an hour.
    """
    known, was_enabled = len(sys.modules), gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if len(sys.modules) > known:
            gc.freeze()
        if was_enabled:
            gc.enable()
