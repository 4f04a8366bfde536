import importlib
import os
import re
import signal
import sys
from pathlib import Path

import pytest

from tests.faults import child_run, faults, hostile_maps
from tests.faults.fault_case import FaultCase, Outcome, run_program
from tests.faults.waiting_child import Moment
from tools import merge

ROOT = Path(__file__).resolve().parents[2]

_PROGRAM = """
from tbmslam.io.atomic_file import write_bytes

def main(argv):
    write_bytes(argv[0], b"1234")
"""


def test_a_fault_that_was_survived_is_a_row_and_exit_0(capsys):
    assert faults.main(["--family", "bags", "--only", "holds nothing"]) == 0
    said = capsys.readouterr()
    assert "| sqlite database that holds nothing |" in said.out
    assert "/base_scan holds no messages: give another recording" in said.out
    assert "1 faults tried, 0 rows red" in said.out
    assert said.err.startswith("ok ")


def test_a_red_row_and_a_trial_that_breaks_are_exit_1(monkeypatch, capsys):
    def broken(_):
        raise RuntimeError("no disk")

    lost = FaultCase("lost", lambda _: Outcome("exit -1", "everything", survived=False))
    monkeypatch.setitem(faults.FAMILIES, "sensors", (lost, FaultCase("broken", broken)))
    assert faults.main(["--family", "sensors"]) == 1
    said = capsys.readouterr().out
    assert "RED" in said
    assert "RuntimeError: no disk" in said
    assert "2 faults tried, 2 rows red" in said


def test_there_is_a_short_form_of_every_family():
    for cases in faults.FAMILIES.values():
        assert 0 < sum(case.quick for case in cases) < len(cases)
        assert len({case.name for case in cases}) == len(cases)


def test_what_leaks_from_a_program_is_seen():
    def leaking(_):
        raise KeyError("topic")

    done = run_program(leaking, "x")
    assert (done.code, done.stderr) == (-1, "leaked KeyError('topic')\n")
    assert not done.is_one_line()


def test_a_child_that_is_not_seen_writing_is_reported(tmp_path):
    moment = Moment(str(tmp_path / "map.npz"), "half", str(tmp_path))
    with pytest.raises(child_run.ChildRunError, match=r"not seen writing .*map.npz"):
        child_run.run_child(merge, "--print-config", at=moment, do=lambda _: None)


@pytest.mark.parametrize(("state", "left"), [("empty", b""), ("half", b"12"), ("whole", b"1234"), ("named", b"1234")])
def test_a_child_waits_at_each_moment_of_the_writing_of_a_file(tmp_path, monkeypatch, state, left):
    (tmp_path / "program.py").write_text(_PROGRAM)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    monkeypatch.syspath_prepend(tmp_path)
    path = tmp_path / "out" / "file"
    path.parent.mkdir()
    path.write_bytes(b"old")
    seen = []

    def kill(group):
        seen.append({file.name: file.read_bytes() for file in path.parent.iterdir()})
        os.killpg(group, signal.SIGKILL)

    moment = Moment(str(path), state, str(tmp_path))
    done = child_run.run_child(importlib.import_module("program"), path, at=moment, do=kill)
    assert done.code == -signal.SIGKILL
    content = seen[0].pop("file")
    assert content == (left if state == "named" else b"old")
    assert list(seen[0].values()) == ([] if state == "named" else [left])


def test_a_map_that_would_be_believed_is_a_red_row(tmp_path):
    case = hostile_maps._case("nothing wrong", lambda _: None, "damaged")
    outcome = case.attempt(tmp_path)
    assert not outcome.survived
    assert outcome.happened.startswith("exit ")


def test_wrong_usage_is_exit_2(capsys):
    with pytest.raises(SystemExit) as left:
        faults.main(["--family", "fire"])
    assert left.value.code == 2


def first_cells(text):
    """Return the first cell of each row of a table but its head."""
    return re.findall(r"^\| ([^|]*?) +\|", text, re.MULTILINE)[1:]


def test_the_page_has_the_table_that_the_program_prints():
    names = [case.name for cases in faults.FAMILIES.values() for case in cases]
    page = (ROOT / "docs/faults.md").read_text("utf-8")
    assert first_cells(page) == names
    assert f"applies {len(names)} faults" in page
