"""Programs run as a child process, as a shell runs them, to be disturbed from outside."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from tbmslam.errors import TbmSlamError
from tests.faults import waiting_child
from tests.faults.fault_case import ProgramRun
from tests.faults.waiting_child import Moment

_ROOT = str(Path(__file__).resolve().parents[2])
_TOO_LONG_S = 300.0
_BLIND_ROOT = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-dac_override,-dac_read_search")
"""Runs a command as a root for whom permissions count, too."""


class ChildRunError(TbmSlamError):
    """A program did not do what was waited for."""


def run_child(
    program: ModuleType,
    *arguments: object,
    at: Moment | None = None,
    do: Callable[[int], object] | None = None,
    largest_file: int | None = None,
    memory: int | None = None,
) -> ProgramRun:
    """Run a program as a child process to its end.

    Parameters
    ----------
    program
        The module with its `main`.
    at
        A moment at which the child waits.
    do
        What is done then, with the number of the group of the child and its own children.
    largest_file, memory
        Sizes that a file of the child and its memory cannot exceed [B].

    Raises
    ------
    ChildRunError
        What was waited for did not come.
    """
    usual = dict(os.environ) if at is None else at.environment()
    blind = _BLIND_ROOT if os.geteuid() == 0 and shutil.which(_BLIND_ROOT[0]) else ()
    names = [program.__name__] if at is None else [waiting_child.__name__, program.__name__]
    command = [*blind, sys.executable, "-m", *names, *map(str, arguments)]
    with subprocess.Popen(  # noqa: S603 - our own programs
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=usual | {"PYTHONPATH": os.pathsep.join(filter(None, (_ROOT, usual.get("PYTHONPATH"))))},
        start_new_session=True,
        preexec_fn=lambda: _prepare(largest_file, memory),  # noqa: PLW1509 - this process has no threads of its own
    ) as child:
        try:
            if at is not None and do is not None:
                _wait(child, at)
                do(child.pid)
                at.pass_by()
            _, said = child.communicate(timeout=_TOO_LONG_S)
        except subprocess.TimeoutExpired:
            raise ChildRunError(f"{program.__name__} did not end within {_TOO_LONG_S:.0f} s") from None
        finally:
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGKILL)
    return ProgramRun(child.returncode, said)


def _wait(child: subprocess.Popen[str], moment: Moment) -> None:
    latest = time.monotonic() + _TOO_LONG_S
    while not moment.has_come():
        if child.poll() is not None or time.monotonic() > latest:
            raise ChildRunError(f"the program was not seen writing {moment.path}")
        time.sleep(0.01)


def _prepare(largest_file: int | None, memory: int | None) -> None:
    """Let a child hear Ctrl-C, also where a shell that runs this in its background does not, and set its limits."""
    import resource

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    for kind, limit in ((resource.RLIMIT_FSIZE, largest_file), (resource.RLIMIT_AS, memory)):
        if limit is not None:
            resource.setrlimit(kind, (limit, limit))
