import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.relations import read_relations
from tbmslam.parallel.worker_pool import WorkerDiedError
from tools.benchmarks.measured_process import forget_peak_memory, in_fresh_process, peak_memory_mb

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
    with pytest.raises(TbmSlamError, match=r"none\.relations: cannot be read as relations"):
        in_fresh_process(read_relations, tmp_path / "none.relations")


def test_an_unknown_error_is_one_line_with_its_kind():
    with pytest.raises(TbmSlamError, match=r"^ZeroDivisionError: [^\n]+$") as caught:
        in_fresh_process(divmod, 1, 0)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def test_a_lack_of_memory_stays_one():
    with pytest.raises(MemoryError):
        in_fresh_process(bytearray, 1 << 62)


def test_a_dead_process_is_reported():
    with pytest.raises(WorkerDiedError, match="perhaps out of memory: run again with fewer --workers"):
        in_fresh_process(os._exit, 9)


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
