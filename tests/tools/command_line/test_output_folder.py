import subprocess
import sys

import pytest

from tools.command_line.output_folder import OutputError, output_folder

TAKING_TURNS = """
import sys, time
from pathlib import Path
from tools.command_line.output_folder import OutputError, output_folder

folder, mine, ends = Path(sys.argv[1]), Path(sys.argv[2]), time.monotonic() + 1.0
while time.monotonic() < ends:
    try:
        with output_folder(folder):
            with mine.open("x"):
                (folder / "result").touch()
            (folder / "result").unlink()
            mine.unlink()
    except OutputError as error:
        if "another run is writing there" not in str(error):
            raise
"""
"""Two that have the folder at a time would both make the file `mine`, which ends them with an error."""


def test_two_runs_never_write_into_one_folder(tmp_path):
    folder = tmp_path / "out"
    with output_folder(folder):
        (folder / "result").touch()
        expected = pytest.raises(
            OutputError, match=r"out: another run is writing there: wait for it, or choose another"
        )
        with expected, output_folder(folder):
            pytest.fail("two at a time")
    with output_folder(folder):
        pass
    assert [path.name for path in folder.iterdir()] == ["result"]


def test_of_runs_that_end_as_others_begin_no_two_have_the_folder(tmp_path):
    command = [sys.executable, "-c", TAKING_TURNS, tmp_path / "a" / "out", tmp_path / "mine"]
    runs = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]  # noqa: S603 - our own
    assert [run.communicate()[1] for run in runs] == ["", ""]


def test_a_lock_left_by_a_run_that_was_killed_does_not_matter(tmp_path):
    (tmp_path / ".tbmslam.lock").touch()
    with output_folder(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_what_was_made_in_vain_is_removed(tmp_path):
    with pytest.raises(ZeroDivisionError), output_folder(tmp_path / "a" / "b"):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_noticed_at_once(tmp_path):
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        expected = pytest.raises(OutputError, match=r"cannot be written into \(.+\): choose another folder with -o")
        with expected, output_folder(folder):
            pytest.fail("this would be too late")
