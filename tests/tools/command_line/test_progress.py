import io
import itertools
import re
import sys

import numba
import pytest
from numba.core import event

from tbmslam.parallel.executor import Progress
from tools.command_line import progress
from tools.command_line.progress import Compiling, ProgressBars, announce_compiling

ANNOUNCED = "compiling for this machine: a minute or two, the first time only"


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def listener():
    """Listen instead of what a program that another test ran in this process left listening."""
    made = Compiling()
    for other in progress._listeners:
        event.unregister("numba:compile", other)
    with event.install_listener("numba:compile", made):
        yield made
    for other in progress._listeners:
        event.register("numba:compile", other)


def twice_compiled():
    """Compile two functions, each of which no cache knows."""
    for number in range(2):
        assert numba.njit(lambda x, n=number: x + n)(1) == 1 + number


def left_on_screen(text):
    """Return the lines that a terminal shows after a text; what follows a carriage return overwrites its line."""
    lines = []
    for line in text.split("\n"):
        shown = ""
        for part in line.split("\r"):
            shown = part + shown[len(part) :]
        lines.append(shown.rstrip())
    return lines


def test_compilation_is_reported_once(listener, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    twice_compiled()
    assert left_on_screen(stream.getvalue()) == [ANNOUNCED, ""]


def test_what_is_compiled_outside_of_any_bar_is_counted_on_a_line_that_vanishes(listener, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("tools.command_line.progress.announce_compiling", lambda: listener)
    shown = []
    monkeypatch.setattr(stream, "flush", lambda: shown.append(left_on_screen(stream.getvalue())[-1]))
    twice_compiled()
    list(ProgressBars().shown(range(2), "mapping", 2, "scans"))
    twice_compiled()
    lines = [line for line, before in itertools.pairwise([*shown, ""]) if line != before]
    assert [line for line in lines if line.startswith("compiling")] == [
        "compiling",
        "compiling, 1 function compiled",
        "compiling, 1 function compiled",
        "compiling, 2 functions compiled",
        "compiling, 2 functions compiled",
        "compiling, 3 functions compiled",
        "compiling, 3 functions compiled",
        "compiling, 4 functions compiled",
    ]
    assert left_on_screen(stream.getvalue()) == [ANNOUNCED, ""]


def test_what_functions_call_is_counted_on_the_same_line(listener, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    called = numba.njit(lambda x: x + 1)
    assert numba.njit(lambda x: called(x) + 1)(1) == 3
    _, _, said = stream.getvalue().partition("\n")
    assert re.findall(r"[a-z][a-z0-9, ]*", said) == [
        "compiling",
        "compiling, 1 function compiled",
        "compiling, 2 functions compiled",
    ]


def test_a_worker_leaves_the_line_to_the_bar_of_its_parent(listener, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("tools.command_line.progress.parent_process", object)
    twice_compiled()
    assert stream.getvalue() == f"{ANNOUNCED}\n"


def test_what_is_compiled_is_counted_on_the_bar_and_its_time_is_no_work(listener, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("tools.command_line.progress.announce_compiling", lambda: listener)
    now = [0.0]
    for index, _ in enumerate(ProgressBars().shown(range(10), "mapping", 10, "scans")):
        (bar,) = listener._bars
        bar._time = lambda: now[0]
        if not index:
            bar.start_t = bar.last_print_t = 0.0
            now[0] += 60.0
            twice_compiled()
        now[0] += 1.0
    assert "mapping: 0/10 scans, 1 function compiled" in stream.getvalue()
    assert "mapping: 0/10 scans, 2 functions compiled" in stream.getvalue()
    assert "scans/s" in bar.format_meter(**bar.format_dict)
    assert bar.format_dict["elapsed"] == pytest.approx(10.0)
    assert listener._bars == []


@pytest.mark.parametrize("stream", [io.StringIO(), None])
def test_there_is_no_progress_without_a_terminal(listener, monkeypatch, stream):
    monkeypatch.setattr(sys, "stderr", stream)
    twice_compiled()
    assert stream is None or stream.getvalue() == ""


def test_a_log_is_told_of_a_long_compilation_once(listener, monkeypatch):
    monkeypatch.setattr("tools.command_line.progress._LONG_S", 0.0)
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    twice_compiled()
    assert stream.getvalue() == f"{ANNOUNCED}\n"


def test_a_worker_tells_of_its_compilation_too():
    assert ProgressBars().told_in_workers() is announce_compiling
    assert Progress().told_in_workers() is None


def test_cached_functions_are_not_counted(listener, monkeypatch):
    known = numba.njit(lambda x: x)
    known(1)
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    known(2)
    assert stream.getvalue() == ""


def test_a_process_listens_once(monkeypatch):
    registered = []
    monkeypatch.setattr("tools.command_line.progress._listeners", [])
    monkeypatch.setattr(
        "tools.command_line.progress.register", lambda kind, listener: registered.append((kind, listener))
    )
    announce_compiling()
    announce_compiling()
    assert [kind for kind, _ in registered] == ["numba:compile"]


class Viewer:
    def __init__(self):
        self.seen = []

    def saw(self, *what):
        self.seen.append(what)

    def finished(self, *what):
        self.seen.append(what)


def used(monkeypatch, stream):
    monkeypatch.setattr(sys, "stderr", stream)
    bars = ProgressBars()
    assert list(bars.each(range(5), "mapping", 5, "scans", "robot_0")) == [0, 1, 2, 3, 4]
    assert bars.seconds.keys() == {"mapping"}
    return stream.getvalue()


def test_a_terminal_shows_rate_and_time_left(monkeypatch):
    said = used(monkeypatch, Terminal())
    assert "robot_0:" in said
    assert "0/5 [00:00<?, ? scans/s]" in said


def test_what_is_no_terminal_stays_quiet(monkeypatch):
    assert used(monkeypatch, io.StringIO()) == ""


def test_the_viewer_receives_readings_and_maps():
    viewer = Viewer()
    bars = ProgressBars(viewer)
    bars.saw("robot_0", "reading", "pose")
    bars.finished("robot_0", "map")
    assert viewer.seen == [("robot_0", "reading", "pose"), ("robot_0", "map")]
    ProgressBars().saw("robot_0", "reading", "pose")
