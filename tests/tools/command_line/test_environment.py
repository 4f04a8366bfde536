"""Settings of a shell that compiled libraries crash on: each program says so in one line."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tools.command_line.environment import UnfitEnvironmentError, check_environment

ROOT = Path(__file__).resolve().parents[3]
PROGRAMS = {"build_maps": ("nowhere.bag", "-o"), "merge": ("nowhere", "nobody", "-o"), "make_world": ("-o",)}


def said_by(program, out, limit=None, **settings):
    """Return exit code and stderr of a program under a limit on its memory [MB] and settings of the environment."""

    def limited():
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_AS, (limit * 10**6, resource.RLIM_INFINITY))

    command = [sys.executable, str(ROOT / "tools" / f"{program}.py"), *PROGRAMS[program], str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **settings}
    run = subprocess.run(  # noqa: S603 - the programs of this repository
        command, env=environment, preexec_fn=limited, capture_output=True, check=False, text=True, timeout=60
    )
    return run.returncode, run.stderr


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("limit", [400, 700, 1250, 1900])
def test_too_little_memory_is_one_line(program, limit, tmp_path):
    code, said = said_by(program, tmp_path, limit)
    assert code == 1
    assert said.startswith(f"{program}: memory is limited to {limit} MB (ulimit -v), and compiled code takes")
    assert said.endswith("raise the limit to 2000000 kB or more\n")
    assert said.count("\n") == 1


@pytest.mark.parametrize("threads", ["abc", "0", "-2", "1.5", "\u0663"])
def test_a_number_of_threads_that_is_none_is_one_line(threads, monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    with pytest.raises(UnfitEnvironmentError, match="not a number of threads: set it to 1 or more"):
        check_environment()
    if threads == "abc":
        code, said = said_by("merge", tmp_path)
        assert (code, said.count("\n")) == (1, 1)


def test_the_usual_environment_is_fit(monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    check_environment()
    monkeypatch.delenv("NUMBA_NUM_THREADS")
    check_environment()
