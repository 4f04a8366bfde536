"""Programs run as a child process, as a shell runs them, to be disturbed from outside."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from tbmslam.errors import TbmSlamError
from tools.fault_cases.program_run import ProgramRun

_Result = TypeVar("_Result")
_TOO_LONG_S = 300.0
_TRIALS = 8
_BLIND_ROOT = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-dac_override,-dac_read_search")
"""Runs a command as a root for whom permissions count, too."""


class ChildRunError(TbmSlamError):
    """A program did not do what was waited for."""


class MissedMomentError(ChildRunError):
    """A program was done before it was seen doing what it was to be disturbed at."""


def until_caught(trial: Callable[[int], _Result]) -> _Result:
    """Make a trial, given its number, until the moment to disturb it at is not missed, as on a busy machine it may be.

    Raises
    ------
    MissedMomentError
        It always was.
    """
    for number in range(_TRIALS - 1):
        with suppress(MissedMomentError):
            return trial(number)
    return trial(_TRIALS - 1)


def run_child(
    program: ModuleType,
    *arguments: object,
    until: Callable[[], bool] | None = None,
    send: signal.Signals = signal.SIGKILL,
    largest_file: int | None = None,
    memory: int | None = None,
) -> ProgramRun:
    """Run a program as a child process to its end.

    Parameters
    ----------
    program
        The module with its `main`.
    until
        When this says so, the child and its own children get a signal; it is asked again and again.
    send
        That signal.
    largest_file, memory
        Sizes that a file of the child and its memory cannot exceed [B].

    Raises
    ------
    ChildRunError
        What was waited for did not come.
    """
    blind = _BLIND_ROOT if os.geteuid() == 0 and shutil.which(_BLIND_ROOT[0]) else ()
    command = [*blind, sys.executable, "-m", program.__name__, *map(str, arguments)]
    with subprocess.Popen(  # noqa: S603 - our own programs
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: _prepare(largest_file, memory),  # noqa: PLW1509 - this process has no threads of its own
    ) as child:
        try:
            if until is not None:
                _wait(child, until)
                os.killpg(child.pid, send)
            _, said = child.communicate(timeout=_TOO_LONG_S)
        except subprocess.TimeoutExpired:
            raise ChildRunError(f"{program.__name__} did not end within {_TOO_LONG_S:.0f} s") from None
        finally:
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGKILL)
    return ProgramRun(child.returncode, said)


def is_being_written(folder: Path, name: str) -> Callable[[], bool]:
    """Return what tells whether a file of this name is just being written in a folder."""
    temporary = re.compile(rf"\.[0-9a-f]{{8}}\.{re.escape(name)}")

    def tells() -> bool:
        try:
            return any(temporary.fullmatch(entry.name) for entry in folder.iterdir())
        except FileNotFoundError:
            return False

    return tells


def _wait(child: subprocess.Popen[str], until: Callable[[], bool]) -> None:
    """Ask until it is time; without a pause, since files are written in milliseconds."""
    latest = time.monotonic() + _TOO_LONG_S
    while not until():
        if child.poll() is not None or time.monotonic() > latest:
            raise MissedMomentError("the program was not seen doing what it was to be disturbed at")


def _prepare(largest_file: int | None, memory: int | None) -> None:
    """Let a child hear Ctrl-C, also where a shell that runs this in its background does not, and set its limits."""
    import resource

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    for kind, limit in ((resource.RLIMIT_FSIZE, largest_file), (resource.RLIMIT_AS, memory)):
        if limit is not None:
            resource.setrlimit(kind, (limit, limit))
