import io
import sys

from tools.command_line.progress import ProgressBars


class Terminal(io.StringIO):
    def isatty(self):
        return True


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


def test_the_viewer_is_told_of_readings_and_maps():
    viewer = Viewer()
    bars = ProgressBars(viewer)
    bars.saw("robot_0", "reading", "pose")
    bars.finished("robot_0", "map")
    assert viewer.seen == [("robot_0", "reading", "pose"), ("robot_0", "map")]
    ProgressBars().saw("robot_0", "reading", "pose")
