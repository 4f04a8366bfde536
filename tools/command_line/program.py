"""A program on the command line: how it was called, its line for an error, its exit code."""

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
from tools.command_line.interruption import Interruption, forget_interruption, hear_interruption, heard_interruption

_LEAST_MB = 2000
"""With two cores two small maps take 1260 MB of address space to be merged, a small drive 1020; with more cores more.
With less the libraries end with a segmentation fault, or wait for ever."""


class UnfitEnvironmentError(TbmSlamError):
    """The program cannot work under what the shell sets."""


def check_environment() -> None:
    """Refuse a limit on memory, or a number of threads, under which compiled code does not work.

    Raises
    ------
    UnfitEnvironmentError
        With the setting and what to set instead.
    """
    limit = _memory_limit()
    if limit is not None and limit < _LEAST_MB * 10**6:
        raise UnfitEnvironmentError(
            f"memory is limited to {limit // 10**6} MB (ulimit -v), and compiled code takes up to {_LEAST_MB} MB: "
            "raise the limit to 2000000 kB or more"
        )
    threads = os.environ.get("NUMBA_NUM_THREADS")
    if threads is not None and not (threads.isascii() and threads.isdigit() and int(threads) > 0):
        raise UnfitEnvironmentError(
            f"NUMBA_NUM_THREADS is {threads!r}, not a number of threads: set it to 1 or more, or leave it unset"
        )


def _memory_limit() -> int | None:
    """Return the limit of the program's address space [bytes]; None if there is none or it is unknown."""
    try:
        import resource
    except ImportError:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def print_anything() -> None:
    """Let names be printed that are no text, with their bytes written out, and messages that hold line ends or worse.

    Python would fail on the former, and a terminal obey the latter.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    for handler in (*logging.getLogger().handlers, logging.lastResort):
        if isinstance(handler, logging.StreamHandler) and handler.stream is sys.stderr:
            handler.setFormatter(_Printable(handler.formatter))


class _Printable(logging.Formatter):
    """Writes a message in one line without control characters."""

    def __init__(self, formatter: logging.Formatter | None) -> None:
        super().__init__()
        self._formatter = formatter or logging.Formatter()

    def format(self, record: logging.LogRecord) -> str:
        """Return the line; the traceback of an exception keeps its own."""
        line, *traceback = self._formatter.format(record).split("\nTraceback", 1)
        return "\nTraceback".join((printable(line), *traceback))


def one_line(error: Exception) -> str:
    """Return the message of an error in one line; errors of the system, such as a too long name, with the name."""
    if isinstance(error, OSError):
        what = error.strerror or error
        named = f"{error.filename}: {what}: check the name, or choose another"
        message = f"{what}: check the input and the output" if error.filename is None else named
    else:
        message = str(error)
    return printable(" ".join(message.splitlines()))  # names of files may hold line ends


DONE, FAILED, WRONG_USAGE = 0, 1, 2
_NO_ROOM = "failed to map segment"
"""The system's message if there is no memory to load a library."""


def ended(
    program: str,
    work: Callable[[], int | None],
    *,
    debug: bool = False,
    interrupted: str = "",
    out_of_memory: str = "reduce the work, or use a larger machine",
) -> int:
    """Do a program's work and return its exit code: what it returns, 1 for a known error, 130 for Ctrl-C.

    Parameters
    ----------
    program
        The name of the program, which starts the line on stderr.
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
        check_environment()
        code = work() or DONE
        if sys.stdout is not None:
            sys.stdout.flush()
        interruption.ends_at_once = True
    except BaseException as error:
        interruption.ends_at_once = True
        # Libraries make errors of their own of an interrupt.
        if isinstance(error, KeyboardInterrupt) or interruption.came is not None:
            say(interruption.line)
            return interruption.code
        no_memory = isinstance(error, MemoryError) or (isinstance(error, ImportError) and _NO_ROOM in str(error))
        is_shown = debug and not (isinstance(error, OSError) and error.filename is None and _prints_nothing())
        if is_shown or not isinstance(error, Exception) or not (no_memory or isinstance(error, TbmSlamError | OSError)):
            raise
        say(f"{program}: {f'memory has run out: {out_of_memory}' if no_memory else one_line(error)}")
        forget_unprinted()
        return FAILED
    finally:
        sys.unraisablehook = dropping
        if heard is None:
            forget_interruption(interruption)
    return code


def forget_unprinted() -> None:
    """Drop buffered output that cannot be printed (full disk, closed pipe): Python would fail on it again."""
    with suppress(AttributeError, ValueError, OSError):  # there is no stdout, or it is none of the system's
        try:
            sys.stdout.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _prints_nothing() -> bool:
    """Return whether stdout accepts no output, by trying."""
    try:
        print(flush=True)
    except OSError:
        return True
    return False


def say(line: str) -> None:
    """Write a line to stderr, if it exists."""
    with suppress(AttributeError, OSError):  # there is no stderr, or it is full
        sys.stderr.write(f"{line}\n")


def typed_command(program: str, arguments: Sequence[str] | None) -> str:
    """Return the command line as a shell takes it.

    Parameters
    ----------
    program
        Name of the program, where it was called from Python with its arguments.
    arguments
        These; None if it was started from a shell.
    """
    return shlex.join(sys.orig_argv if arguments is None else [*program.split(), *arguments])


def examples(text: str, program: str) -> str:
    """Return the examples for the way the program was called: as a file of the source tree, or installed."""
    if " " in program:  # a command of the installed tbmslam
        text = text.replace("python tools/%(prog)s.py", "%(prog)s")
    return text.replace("%(prog)s", program)


_EXIT_CODES = "exit codes: "
_USUAL_CODES = f"\n{_EXIT_CODES}0 done, 1 something is wrong (one line says what), 2 wrong usage, 130 interrupted\n"


class ProgramParser(argparse.ArgumentParser):
    """Parser of a program's command line that keeps the line breaks of the description and the examples.

    In contrast to Python's parser it reports wrong usage in one line, reads -1e-5 as a number, and fails if the help
    cannot be printed. It adds the usual exit codes to an epilog without any.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{"formatter_class": argparse.RawDescriptionHelpFormatter, **settings})
        if self.epilog:
            self.epilog = examples(self.epilog if _EXIT_CODES in self.epilog else self.epilog + _USUAL_CODES, self.prog)
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """Write the error in one line, and end the program."""
        say(f"{self.prog}: error: {printable(' '.join(message.splitlines()))} ({self.prog} --help lists all options)")
        sys.exit(WRONG_USAGE)

    def print_help(self, file: IO[str] | None = None) -> None:  # type: ignore[override]  # typeshed wants less of a file
        """Print the help on stdout or into a file; where stdout takes none, end the program with one line."""
        if file is not None or sys.stdout is None:
            super().print_help(file)
            return
        try:
            sys.stdout.write(self.format_help())
            sys.stdout.flush()
        except OSError as error:
            say(f"{self.prog.split()[0]}: {one_line(error)}")
            forget_unprinted()
            sys.exit(FAILED)


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
