"""How a program ends: with an exit code, and with one line where something went wrong."""

import os
import sys
from collections.abc import Callable
from contextlib import suppress

from tbmslam.errors import TbmSlamError
from tools.command_line.console import one_line, print_anything
from tools.command_line.interruption import forget_interruption, hear_interruption, heard_interruption

DONE, FAILED = 0, 1


def ended(
    program: str,
    work: Callable[[], int | None],
    *,
    debug: bool = False,
    interrupted: str = "",
    out_of_memory: str = "do less at once, or use a larger machine",
) -> int:
    """Do a program's work and return its exit code: what it returns, 1 for a known error, 130 for Ctrl-C.

    Parameters
    ----------
    program
        Its name, which begins the line on stderr.
    work
        What it does after its arguments were understood.
    debug
        Show where a known error came from.
    interrupted, out_of_memory
        What may be done then.
    """
    heard, dropping = heard_interruption(), sys.unraisablehook
    interruption = heard or hear_interruption(program)
    interruption.advice = interrupted
    interruption.hear_what_is_dropped(dropping)
    try:
        interruption.ends_at_once = False
        print_anything()
        code = work() or DONE
        if sys.stdout is not None:
            sys.stdout.flush()
        interruption.ends_at_once = True
    except BaseException as error:
        interruption.ends_at_once = True
        # Libraries, gtsam for one, make errors of their own of an interrupt.
        if isinstance(error, KeyboardInterrupt) or interruption.came is not None:
            say(interruption.line)
            return interruption.code
        is_shown = debug and not (isinstance(error, OSError) and error.filename is None and _prints_nothing())
        if is_shown or not isinstance(error, TbmSlamError | OSError | MemoryError):
            raise
        no_memory = isinstance(error, MemoryError)
        say(f"{program}: {f'memory has run out: {out_of_memory}' if no_memory else one_line(error)}")
        forget_unprinted()
        return FAILED
    finally:
        sys.unraisablehook = dropping
        if heard is None:
            forget_interruption(interruption)
    return code


def forget_unprinted() -> None:
    """Drop what cannot be printed, on a full disk or for nobody who reads it: Python would fail on it once more."""
    with suppress(AttributeError, ValueError, OSError):  # there is no stdout, or it is none of the system's
        try:
            sys.stdout.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _prints_nothing() -> bool:
    """Tell whether stdout takes nothing more, as only trying tells."""
    try:
        print(flush=True)
    except OSError:
        return True
    return False


def say(line: str) -> None:
    """Say a line on stderr, where there is one."""
    with suppress(AttributeError, OSError):  # there is no stderr, or it is full
        sys.stderr.write(f"{line}\n")
