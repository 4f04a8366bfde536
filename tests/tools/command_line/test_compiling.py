import io
import sys

import numba
import pytest
from numba.core import event

from tools.command_line import compiling
from tools.command_line.compiling import Compiling, tell_of_compiling
from tools.command_line.progress import ProgressBars


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def listener():
    """Listen instead of what a program that another test ran in this process left listening."""
    made = Compiling()
    for other in compiling._listeners:
        event.unregister("numba:compile", other)
    with event.install_listener("numba:compile", made):
        yield made
    for other in compiling._listeners:
        event.register("numba:compile", other)


def twice_compiled():
    """Compile two functions, each of which no cache knows."""
    for number in range(2):
        assert numba.njit(lambda x, n=number: x + n)(1) == 1 + number


def test_compiling_is_told_once(listener, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    twice_compiled()
    assert stream.getvalue().splitlines() == ["compiling for this machine: a minute or two, the first time only"]


def test_what_is_compiled_is_counted_on_the_bar_and_its_time_is_no_work(listener, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("tools.command_line.progress.tell_of_compiling", lambda: listener)
    now = [0.0]
    for index, _ in enumerate(ProgressBars().shown(range(10), "mapping", 10, "scans")):
        (bar,) = listener._bars
        bar._time = lambda: now[0]
        if not index:
            bar.start_t = bar.last_print_t = 0.0
            now[0] += 60.0
            twice_compiled()
        now[0] += 1.0
    assert "2 functions compiled" in stream.getvalue()
    assert bar.format_dict["elapsed"] == pytest.approx(10.0)
    assert listener._bars == []


@pytest.mark.parametrize("stream", [io.StringIO(), None])
def test_what_is_no_terminal_is_told_nothing(listener, monkeypatch, stream):
    monkeypatch.setattr(sys, "stderr", stream)
    twice_compiled()
    assert stream is None or stream.getvalue() == ""


def test_what_was_compiled_before_is_not_told(listener, monkeypatch):
    known = numba.njit(lambda x: x)
    known(1)
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    known(2)
    assert stream.getvalue() == ""


def test_a_process_listens_once(monkeypatch):
    registered = []
    monkeypatch.setattr("tools.command_line.compiling._listeners", [])
    monkeypatch.setattr(
        "tools.command_line.compiling.register", lambda kind, listener: registered.append((kind, listener))
    )
    tell_of_compiling()
    tell_of_compiling()
    assert [kind for kind, _ in registered] == ["numba:compile"]
