"""Ctrl-C and kills at given moments of whole programs: one line and exit code 130, never a traceback."""

import os
import signal
import sys
import threading
import time

import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.map_folder import save_map
from tbmslam.map.tbm_map import TbmMap
from tests.processes import ROOT, python
from tools.command_line.interruption import Interruption, handle_interruption, restore_handlers
from tools.command_line.program import run_program

INTERRUPTED_WHILE_LOADING = """
import runpy, signal, sys
wanted, sys.argv = int(sys.argv[1]), sys.argv[2:]
signal.signal(signal.SIGINT, signal.default_int_handler)  # as on a terminal
loaded = 0
def watch(event, args):
    global loaded
    if event == "import" and signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        loaded += 1
        if loaded == wanted:
            signal.raise_signal(signal.SIGINT)
sys.addaudithook(watch)
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""Runs a program that hears Ctrl-C when it begins to load its module of a number."""

PROGRAMS = {
    "build_maps": ["nothing.bag", "-o", "out"],
    "merge": ["robot_0", "robot_1", "-o", "merged"],
    "evaluate": ["map", "robot_0", "--truth", "robot_1"],
    "benchmark": ["slam", "nothing.bag"],
    "make_world": ["-o", "out"],
    "download": ["--list"],
    "reproduce_paper": ["--maps", "robot_0", "-o", "out"],
    "calibrate_deformed": [],
    "calibrate_merging": ["robot_0"],
    "make_map_pairs": ["-o", "out"],
}


@pytest.fixture
def on_a_terminal():
    """What a shell starts behind itself does not hear Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    killed = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGINT, before)
    signal.signal(signal.SIGTERM, killed)


def interrupted_at(tmp_path, number, program):
    words = [INTERRUPTED_WHILE_LOADING, number, ROOT / f"tools/{program}.py", *PROGRAMS[program]]
    return python("-c", *words, cwd=tmp_path)


def assert_is_interrupted(done, program):
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr.startswith(f"{program}: interrupted")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_program_hears_ctrl_c_before_it_loads_anything_else(tmp_path, program):
    assert_is_interrupted(interrupted_at(tmp_path, 1, program), program)


@pytest.mark.parametrize("number", [60, 250, 400, 600])
@pytest.mark.parametrize("program", ["build_maps", "merge", "evaluate", "benchmark"])
def test_ctrl_c_while_compiled_code_is_loaded_is_one_line(tmp_path, program, number):
    for name in ("robot_0", "robot_1"):
        save_map(tmp_path / name, TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 3, 4))))
    (tmp_path / "nothing.bag").touch()
    assert_is_interrupted(interrupted_at(tmp_path, number, program), program)


def test_an_installed_command_hears_it_before_it_loads_its_program(tmp_path):
    begin = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        name == 'argparse' and signal.raise_signal(signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
        "from tbmslam.commands import run; sys.argv[1:] = ['merge']; sys.exit(run())"
    )
    done = python("-c", begin, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (130, "tbmslam merge: interrupted\n")


@pytest.fixture
def ends(monkeypatch):
    """Let a program's end be an exception, and keep its codes and what is written at once."""
    codes, lines = [], []

    def leave(code):
        codes.append(code)
        raise SystemExit

    monkeypatch.setattr(os, "_exit", leave)
    monkeypatch.setattr(os, "write", lambda _, line: lines.append(line.decode()))
    return codes, lines


@pytest.mark.usefixtures("on_a_terminal")
def test_a_second_ctrl_c_does_not_wait_for_the_first(ends):
    def tidy_for_long():
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)

    run_program("merge", tidy_for_long)
    assert ends == ([130], ["merge: interrupted\n"])


@pytest.mark.usefixtures("on_a_terminal")
def test_ctrl_c_that_a_library_makes_an_error_of_is_ctrl_c(capsys):
    def load():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None

    assert run_program("merge", load, interrupted="run the same again") == 130
    assert capsys.readouterr().err == "merge: interrupted: run the same again\n"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("on_a_terminal")
def test_ctrl_c_that_compiled_code_drops_is_raised_again(capfd):
    class Dropping:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    def work():
        Dropping()  # what is raised there reaches nobody
        for _ in range(1000):
            time.sleep(0.01)
        return 0

    before = sys.unraisablehook
    assert run_program("merge", work) == 130
    assert capfd.readouterr().err == "merge: interrupted\n"
    assert sys.unraisablehook is before


def test_other_dropped_errors_are_reported_as_usual(monkeypatch):
    class Failing:
        def __del__(self):
            raise ValueError("dropped")

    told = []
    monkeypatch.setattr(sys, "unraisablehook", lambda what: told.append(str(what.exc_value)))

    def work():
        Failing()

    assert run_program("merge", work) == 0
    assert told == ["dropped"]


@pytest.mark.usefixtures("on_a_terminal")
def test_who_is_not_to_hear_ctrl_c_does_not():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell begins what runs in its background
    try:
        handle_interruption("merge")
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("on_a_terminal")
def test_a_second_call_returns_the_first_handler():
    first = handle_interruption("merge")
    assert isinstance(first, Interruption)
    assert handle_interruption("another") is first is signal.getsignal(signal.SIGINT)
    restore_handlers(first)


ENDS_WITH_A_THREAD = """
import atexit, signal, sys
from tests.processes import ROOT, python
from tools.command_line.interruption import handle_interruption
from tools.command_line.program import run_program
handle_interruption("merge")
atexit.register(lambda: print("tidied"))
class Late:
    def __del__(self): print("taken apart")
late = Late()
def work():
    if sys.argv[1] == "killed":
        signal.raise_signal(signal.SIGTERM)
sys.exit(run_program("merge", work))
"""


@pytest.mark.parametrize(("how", "code", "said"), [("killed", 143, "tidied\n"), ("done", 0, "tidied\ntaken apart\n")])
def test_an_interrupted_program_tidies_and_is_not_taken_apart(how, code, said):
    """Compiled code may still run in threads, and crashes where Python is taken apart beneath it."""
    run = python("-c", ENDS_WITH_A_THREAD, how)
    assert (run.returncode, run.stdout) == (code, said)


@pytest.mark.usefixtures("on_a_terminal")
def test_a_kill_that_asks_is_one_line_and_lets_tidy(capsys):
    tidied = []

    def work():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            tidied.append(True)

    assert run_program("merge", work, interrupted="run the same again") == 143
    assert capsys.readouterr().err == "merge: terminated: run the same again\n"
    assert tidied == [True]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.usefixtures("on_a_terminal")
def test_a_thread_of_somebody_leaves_ctrl_c_to_the_main_one():
    codes = []
    thread = threading.Thread(target=lambda: codes.append(run_program("merge", lambda: 3)))
    thread.start()
    thread.join()
    assert codes == [3]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
