import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tbmslam.evaluation.relations import read_relations
from tools.benchmarks.measured_process import (
    MeasurementError,
    forget_peak_memory,
    in_fresh_process,
    in_fresh_processes,
    peak_memory_mb,
)

ROOT = Path(__file__).resolve().parents[3]


def test_a_call_is_made_in_another_process():
    assert in_fresh_process(os.getpid) != os.getpid()


def test_memory_is_that_of_the_process_alone():
    held = bytearray(200_000_000)
    held[::4096] = b"x" * len(held[::4096])
    here = peak_memory_mb()
    assert here > 200.0
    assert in_fresh_process(peak_memory_mb) < here - 150.0


@pytest.mark.skipif(not os.access("/proc/self/clear_refs", os.W_OK), reason="needs a system that forgets its peak")
def test_a_peak_can_be_forgotten():
    held = bytearray(200_000_000)
    held[::4096] = b"x" * len(held[::4096])
    before = peak_memory_mb()
    del held
    forget_peak_memory()
    assert peak_memory_mb() < before - 150.0


def test_a_known_error_keeps_its_line(tmp_path):
    with pytest.raises(MeasurementError, match=r"none\.relations: cannot be read as relations"):
        in_fresh_process(read_relations, tmp_path / "none.relations")


def test_a_dead_process_is_reported():
    with pytest.raises(MeasurementError, match=r"the process died \(exit code 9\): memory may have run out"):
        in_fresh_process(os._exit, 9)


def test_several_calls_are_made_side_by_side(tmp_path):
    def met():  # each waits for the other
        here, there = tmp_path / "here", tmp_path / "there"
        return [(str(here), str(there)), (str(there), str(here))]

    assert sorted(in_fresh_processes(meet, met(), 2)) == [(0, True), (1, True)]


def meet(mine, other):
    Path(mine).touch()
    latest = time.monotonic() + 60.0
    while not Path(other).exists() and time.monotonic() < latest:
        time.sleep(0.01)
    return Path(other).exists()


def test_one_at_a_time_is_in_order_and_a_failure_is_an_answer(tmp_path):
    missing = tmp_path / "none.relations"
    answers = list(in_fresh_processes(read_relations, [(missing,), (missing,)], 1))
    assert [number for number, _ in answers] == [0, 1]
    assert all(isinstance(answer, MeasurementError) and "none.relations" in str(answer) for _, answer in answers)
    assert list(in_fresh_processes(read_relations, [], 3)) == []


def test_whoever_stops_asking_leaves_no_process_behind():
    calls = in_fresh_processes(time.sleep, [(0.0,), (60.0,)], 2)
    assert next(calls) == (0, None)
    began = time.monotonic()
    calls.close()
    assert time.monotonic() - began < 20.0
    assert not multiprocessing.active_children()


SLEEPING = """
import time
from pathlib import Path

def sleep_and_tell(path):
    Path(path).touch()
    time.sleep(60)
"""

WAITING = """
import signal, sys
from sleeping import sleep_and_tell
from tools.benchmarks.measured_process import in_fresh_process
from tools.command_line.program import run_program
signal.signal(signal.SIGINT, signal.default_int_handler)  # as on a terminal
sys.exit(run_program("benchmark", lambda: in_fresh_process(sleep_and_tell, sys.argv[1])))
"""


def is_there(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_ctrl_c_ends_the_process_with_one_message(tmp_path):
    (tmp_path / "sleeping.py").write_text(SLEEPING)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    command = [sys.executable, "-c", WAITING, str(tmp_path / "here")]
    with subprocess.Popen(  # noqa: S603 - a fixed command
        command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as program:
        while not (tmp_path / "here").exists():
            assert program.poll() is None
            time.sleep(0.01)
        os.killpg(program.pid, signal.SIGINT)
        _, said = program.communicate(timeout=30)
    assert (program.returncode, said) == (130, "benchmark: interrupted\n")
    latest = time.monotonic() + 10.0
    while is_there(program.pid) and time.monotonic() < latest:  # Python's own helper notices a little later
        time.sleep(0.01)
    assert not is_there(program.pid)
