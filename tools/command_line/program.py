"""Common parts of the programs: the name in use, error messages and exit codes."""

import argparse
import gc
import io
import logging
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import IO, Any, NoReturn

from tbmslam.errors import TbmSlamError, printable
from tbmslam.machine_memory import address_space
from tools.command_line.interruption import Interruption, handle_interruption, installed_interruption, restore_handlers

_LEAST_MB = 2000
"""Least address space [MB]. On two cores, a merge of two small maps takes 1260 MB and a small drive 1020 MB; more cores
take more. With less, libraries crash or hang."""


def check_environment() -> None:
    """Refuse a limit on memory, or a number of threads, under which compiled code does not work."""
    limit = address_space()
    if limit < _LEAST_MB * 10**6:
        raise TbmSlamError(
            f"memory is limited to {limit // 10**6} MB (ulimit -v), and compiled code takes up to {_LEAST_MB} MB: "
            "raise the limit to 2000000 kB or more"
        )
    threads = os.environ.get("NUMBA_NUM_THREADS")
    if threads is not None and not (threads.isascii() and threads.isdigit() and int(threads) > 0):
        raise TbmSlamError(
            f"NUMBA_NUM_THREADS is {threads!r}, not a number of threads: set it to 1 or more, or leave it unset"
        )


def escape_output() -> None:
    """Print names that are not text with their bytes escaped, and messages without control characters.

    Python would fail on such names, and a terminal would execute control characters. Each line is written at once, also
    to a pipe or a file: a user follows the robots of a long run there.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace", line_buffering=True)
    for handler in (*logging.getLogger().handlers, logging.lastResort):
        if isinstance(handler, logging.StreamHandler) and handler.stream is sys.stderr:
            handler.setFormatter(_Printable(handler.formatter))


class _Printable(logging.Formatter):
    """Writes a message in one line without control characters."""

    def __init__(self, formatter: logging.Formatter | None) -> None:
        super().__init__()
        self._formatter = formatter or logging.Formatter()

    def format(self, record: logging.LogRecord) -> str:
        """Return the message in one line; tracebacks keep their lines."""
        line, *traceback = self._formatter.format(record).split("\nTraceback", 1)
        return "\nTraceback".join((printable(line), *traceback))


def one_line(error: Exception) -> str:
    """Return the message of an error in one line, with the file name of system errors."""
    if isinstance(error, OSError):
        what = error.strerror or error
        named = f"{error.filename}: {what}: check the name, or choose another"
        message = f"{what}: check the input and the output" if error.filename is None else named
    else:
        message = str(error)
    return printable(" ".join(message.splitlines()))  # file names may contain line breaks


DONE, FAILED, WRONG_USAGE = 0, 1, 2
_NO_ROOM = "failed to map segment"  # the system's message if memory is too small to load a library
_THRESHOLDS = 50_000, 20, 50
"""How rarely Python collects garbage, see `gc.set_threshold`. Compilation creates millions of objects that stay: with
Python's 700, 10, 10 the first map takes 7 % longer, and a later one 3 %."""


def run_program(
    program: str,
    work: Callable[[], int | None],
    *,
    debug: bool = False,
    interrupted: str = "",
    out_of_memory: str = "reduce the work, or use a larger machine",
) -> int:
    """Do a program's work and return its exit code: the result, 1 for a known error, 130 for Ctrl-C.

    Messages on stderr begin with the name of the program and end with the advice for an interruption or a lack of
    memory. `debug` prints the traceback of known errors.
    """
    heard, dropping, thresholds = installed_interruption(), sys.unraisablehook, gc.get_threshold()
    interruption = heard or handle_interruption(program)
    interruption.advice = interrupted
    interruption.repeat_dropped_interrupts(dropping)
    gc.set_threshold(*_THRESHOLDS)
    try:
        interruption.ends_at_once = False
        escape_output()
        check_environment()
        code = work() or DONE
        if sys.stdout is not None:
            sys.stdout.flush()
        interruption.ends_at_once = True
    except BaseException as error:
        interruption.ends_at_once = True
        # Libraries turn an interrupt into other errors.
        if isinstance(error, KeyboardInterrupt) or interruption.came is not None:
            say(interruption.line)
            return interruption.code
        no_memory = isinstance(error, MemoryError) or (isinstance(error, ImportError) and _NO_ROOM in str(error))
        is_shown = debug and not (isinstance(error, OSError) and error.filename is None and _prints_nothing())
        if is_shown or not isinstance(error, Exception) or not (no_memory or isinstance(error, TbmSlamError | OSError)):
            raise
        if not _has_lost_its_reader(error):
            say(f"{program}: {f'memory has run out: {out_of_memory}' if no_memory else one_line(error)}")
        discard_output()
        return FAILED
    finally:
        gc.set_threshold(*thresholds)
        sys.unraisablehook = dropping
        if heard is None:
            restore_handlers(interruption)
    return code


def discard_output() -> None:
    """Discard buffered output that cannot be printed (full disk, closed pipe), on which Python would fail again."""
    with suppress(AttributeError, ValueError, OSError):  # there is no stdout, or it is not a file
        try:
            sys.stdout.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _prints_nothing() -> bool:
    """Return whether stdout fails to accept output."""
    try:
        print(flush=True)
    except OSError:
        return True
    return False


def _has_lost_its_reader(error: BaseException) -> bool:
    """Return whether stdout is a pipe whose reader has read enough, such as `head`: no reason for a message."""
    return isinstance(error, BrokenPipeError) and _prints_nothing()


def say(line: str) -> None:
    """Write a line to stderr, if it exists."""
    with suppress(AttributeError, OSError):  # there is no stderr, or it is full
        sys.stderr.write(f"{line}\n")


def typed_command(program: str, arguments: Sequence[str] | None) -> str:
    """Return the command line as typed in a shell.

    If `arguments` is None, it is the command line that started Python.
    """
    return shlex.join(sys.orig_argv if arguments is None else [*program.split(), *arguments])


_EXIT_CODES = "exit codes: "
_USUAL_CODES = (
    f"\n{_EXIT_CODES}0 done, 1 error, described in one line, 2 wrong usage, 130 interrupted, 143 terminated\n"
)


class ProgramParser(argparse.ArgumentParser):
    """Parser of a program's command line that keeps the line breaks of the description and the examples.

    In contrast to Python's parser it reports wrong usage in one line, reads -1e-5 as a number, and fails if the help
    cannot be printed. It adds the usual exit codes to an epilog without any.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{"formatter_class": argparse.RawDescriptionHelpFormatter, **settings})
        if self.epilog and _EXIT_CODES not in self.epilog:
            self.epilog += _USUAL_CODES
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """Write the error in one line, and end the program."""
        say(f"{self.prog}: error: {printable(' '.join(message.splitlines()))} ({self.prog} --help lists all options)")
        sys.exit(WRONG_USAGE)

    def print_help(self, file: IO[str] | None = None) -> None:  # type: ignore[override]  # typeshed requires less of a file
        """Print the help to stdout or a file; if stdout fails, end the program with an error message."""
        if file is not None or sys.stdout is None:
            super().print_help(file)
            return
        try:
            sys.stdout.write(self.format_help())
            sys.stdout.flush()
        except OSError as error:
            if not _has_lost_its_reader(error):
                say(f"{self.prog.split()[0]}: {one_line(error)}")
            discard_output()
            sys.exit(FAILED)


@contextmanager
def loading() -> Iterator[None]:
    """Load modules in a block without garbage collection; Ctrl-C ends the program at once.

    Compiled code creates hundreds of thousands of permanent objects. Repeated garbage collection of them would take
    longer than reading a drive of 15 minutes.
    """
    known, was_enabled = len(sys.modules), gc.isenabled()
    interruption = installed_interruption() or Interruption("")
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
