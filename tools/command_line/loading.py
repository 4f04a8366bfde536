"""Modules that a program loads and keeps."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from tools.command_line.interruption import Interruption, heard_interruption


@contextmanager
def loading() -> Iterator[None]:
    """Load modules in a block, and never look for garbage in what they are made of; Ctrl-C ends the program at once.

    Compiled code brings hundreds of thousands of objects that live as long as the program; to search them again and
    again, while they come and later on, takes longer than to read a drive of a quarter of an hour.
    """
    known, was_enabled = len(sys.modules), gc.isenabled()
    interruption = heard_interruption() or Interruption("")
    ended_at_once = interruption.ends_at_once
    gc.disable()
    try:
        interruption.ends_at_once = True
        yield
    finally:
        interruption.ends_at_once = ended_at_once
        if len(sys.modules) > known:
            gc.freeze()
        if was_enabled:
            gc.enable()
