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

_SIGNALS: dict[signal.Signals, tuple[Any, str]] = {
    signal.SIGINT: (signal.default_int_handler, "interrupted"),
    signal.SIGTERM: (signal.SIG_DFL, "terminated"),
}
"""Signals that end a program, with Python's default handlers and their names in messages."""
_AGAIN_S = 0.05


class Interruption:
    """The handler of signals that end a program.

    `advice` is added to the message. `came` is the first signal. `ends_at_once` tells whether a signal ends the program
    at once, while there is nothing to clean up: modules that are being loaded turn `KeyboardInterrupt` into other
    errors, or ignore it. Else `KeyboardInterrupt` is raised, and a second signal ends the program.
    """

    def __init__(self, program: str) -> None:
        self.program = program
        self.advice = ""
        self.ends_at_once = True
        self.came: int | None = None

    @property
    def line(self) -> str:
        """The message before the program ends."""
        what = _SIGNALS[signal.Signals(self.came or signal.SIGINT)][1]
        return f"{self.program}: {what}" + (f": {self.advice}" if self.advice else "")

    @property
    def code(self) -> int:
        """Exit code of the program."""
        return 128 + (self.came or signal.SIGINT)

    def __call__(self, number: int, _: object) -> None:
        """Handle a signal."""
        is_first, self.came = self.came is None, self.came or number
        if self.ends_at_once or not is_first:
            os.write(2, f"{self.line}\n".encode())  # sys.stderr may be in use
            os._exit(self.code)
        raise KeyboardInterrupt

    def end_at_last(self) -> None:
        """End an interrupted program after the cleanup and before the finalisation of Python.

        Threads of compiled code may still run, and would crash during the finalisation.
        """
        if self.came is not None:
            for stream in (sys.stdout, sys.stderr):
                with suppress(AttributeError, ValueError, OSError):
                    stream.flush()
            os._exit(self.code)

    def repeat_dropped_interrupts(self, drop: "Callable[[sys.UnraisableHookArgs], object]") -> None:
        """Repeat an interrupt that Python dropped, for example in a callback of compiled code."""

        def dropped(what: "sys.UnraisableHookArgs") -> None:
            if issubclass(what.exc_type, KeyboardInterrupt) and self.came is not None:
                came, self.came = self.came, None
                threading.Timer(_AGAIN_S, _thread.interrupt_main, [came]).start()
            else:
                drop(what)

        sys.unraisablehook = dropped


def installed_interruption() -> Interruption | None:
    """Return the installed handler; None for those of Python."""
    hearing = (signal.getsignal(number) for number in _SIGNALS)
    return next((handler for handler in hearing if isinstance(handler, Interruption)), None)


def handle_interruption(program: str) -> Interruption:
    """Install and return the handler of signals that end a program, or return the installed handler.

    A program in the background of a shell ignores Ctrl-C, and only the main thread can handle signals.
    """
    interruption = installed_interruption() or Interruption(program)
    atexit.register(interruption.end_at_last)  # the first registered function is called last
    if threading.current_thread() is threading.main_thread():
        for number, (usual, _) in _SIGNALS.items():
            if signal.getsignal(number) is usual:
                signal.signal(number, interruption)
    return interruption


def restore_handlers(interruption: Interruption) -> None:
    """Restore Python's handlers of the signals."""
    atexit.unregister(interruption.end_at_last)
    for number, (usual, _) in _SIGNALS.items():
        if signal.getsignal(number) is interruption:
            signal.signal(number, usual)
