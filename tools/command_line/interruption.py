"""Interruption of a program by Ctrl-C or SIGTERM: one line and an exit code, no traceback.

Signals before the first line of the program get Python's own handling.
"""

import _thread
import atexit
import os
import signal
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

INTERRUPTED = 128 + signal.SIGINT
"""Exit code of a program that Ctrl-C ended, by the convention of shells."""

_HEARD: dict[signal.Signals, tuple[Any, str]] = {
    signal.SIGINT: (signal.default_int_handler, "interrupted"),
    signal.SIGTERM: (signal.SIG_DFL, "terminated"),
}
"""Signals that end a program, with Python's default handlers and their names in messages."""
_AGAIN_S = 0.05


class Interruption:
    """What a program does when it is to end.

    Parameters
    ----------
    program
        The name of the program, for its message.

    Attributes
    ----------
    advice
        The rest of the message.
    ends_at_once
        Whether it ends there and then, as is right while there is nothing to tidy: modules that are just being loaded
        make errors of their own of it, or forget it. Else `KeyboardInterrupt` is raised, and a second signal ends it.
    came
        The signal that came.
    """

    def __init__(self, program: str) -> None:
        self.program = program
        self.advice = ""
        self.ends_at_once = True
        self.came: int | None = None

    @property
    def line(self) -> str:
        """The message before the program ends."""
        what = _HEARD[signal.Signals(self.came or signal.SIGINT)][1]
        return f"{self.program}: {what}" + (f": {self.advice}" if self.advice else "")

    @property
    def code(self) -> int:
        """Its exit code."""
        return 128 + (self.came or signal.SIGINT)

    def __call__(self, number: int, _: object) -> None:
        """Hear a signal."""
        is_first, self.came = self.came is None, self.came or number
        if self.ends_at_once or not is_first:
            os.write(2, f"{self.line}\n".encode())  # the stream of that name may be in the midst of a line
            os._exit(self.code)
        raise KeyboardInterrupt

    def end_at_last(self) -> None:
        """End a program that was interrupted when all is tidied, before Python takes itself apart.

        Threads of compiled code may still run then, and crash where what they use is gone.
        """
        if self.came is not None:
            for stream in (sys.stdout, sys.stderr):
                with suppress(AttributeError, ValueError, OSError):
                    stream.flush()
            os._exit(self.code)

    def hear_what_is_dropped(self, drop: "Callable[[sys.UnraisableHookArgs], object]") -> None:
        """Hear it a little later once more where it is dropped, as by what compiled code calls back.

        Parameters
        ----------
        drop
            What is done with all else that is dropped.
        """

        def dropped(what: "sys.UnraisableHookArgs") -> None:
            if issubclass(what.exc_type, KeyboardInterrupt) and self.came is not None:
                came, self.came = self.came, None
                threading.Timer(_AGAIN_S, _thread.interrupt_main, [came]).start()
            else:
                drop(what)

        sys.unraisablehook = dropped


def heard_interruption() -> Interruption | None:
    """Return how this program hears what ends it; None if it does as Python does."""
    hearing = (signal.getsignal(number) for number in _HEARD)
    return next((handler for handler in hearing if isinstance(handler, Interruption)), None)


def hear_interruption(program: str) -> Interruption:
    """Install the handling of signals that end a program, and return it; it is kept if it is installed already.

    A shell that begins a program in the background has it hear no Ctrl-C, and only a main thread can.
    """
    interruption = heard_interruption() or Interruption(program)
    atexit.register(interruption.end_at_last)  # what is registered first is called last
    if threading.current_thread() is threading.main_thread():
        for number, (usual, _) in _HEARD.items():
            if signal.getsignal(number) is usual:
                signal.signal(number, interruption)
    return interruption


def forget_interruption(interruption: Interruption) -> None:
    """Have the signals do again what they usually do."""
    atexit.unregister(interruption.end_at_last)
    for number, (usual, _) in _HEARD.items():
        if signal.getsignal(number) is interruption:
            signal.signal(number, usual)
