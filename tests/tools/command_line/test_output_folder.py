import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.map_folder import save_map
from tbmslam.map.tbm_map import TbmMap
from tools.command_line.output_folder import NAME, OutputError, changed_files, output_folder, write_checksums

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


@pytest.fixture
def folder(tmp_path):
    masses = np.tile(np.array([0, 1, 0, 0], dtype=np.float32), (3, 4, 1))
    save_map(tmp_path, TbmMap(TbmGrid(GridGeometry(0.05, 0.0, 0.0, 3, 4), masses)))
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "notes.txt").write_text("the user's own")
    (tmp_path / "report.html").write_text("took 3 s")
    write_checksums(tmp_path)
    return tmp_path


def test_files_are_as_they_were_written(folder):
    assert changed_files(folder) == []
    text = (folder / NAME).read_text()
    assert [line.split("  ")[1] for line in text.splitlines()] == [
        *("conflict.png", "free.png", "map.npz", "map.pgm", "map.yaml", "occupied.png", "pignistic.pgw"),
        *("pignistic.png", "run.json", "unknown.png"),
    ]


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="sha256sum is not installed")
def test_other_programs_read_them(folder):
    command = ["sha256sum", "--check", "--strict", NAME]
    done = subprocess.run(command, cwd=folder, check=False, capture_output=True)  # noqa: S603 - a fixed command
    assert done.returncode == 0, done.stderr


def test_a_changed_byte_and_a_missing_file_are_noticed(folder):
    content = (folder / "map.pgm").read_bytes()
    (folder / "map.pgm").write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    (folder / "run.json").unlink()
    assert changed_files(folder) == ["map.pgm", "run.json"]


@pytest.mark.parametrize("noted", [None, b"\xff\xfe"])
def test_nothing_is_known_without_checksums(folder, noted):
    (folder / NAME).unlink()
    if noted is not None:
        (folder / NAME).write_bytes(noted)
    assert changed_files(folder) is None


def test_no_file_elsewhere_is_looked_at(folder):
    (folder / NAME).write_text(f"{'0' * 64}  ../../etc/passwd\nno checksum\n")
    assert changed_files(folder) == ["../../etc/passwd", ""]


@pytest.mark.parametrize("name", ["map.npz", NAME])
def test_a_pipe_is_not_waited_for(folder, name):
    (folder / name).unlink()
    os.mkfifo(folder / name)
    assert changed_files(folder) == (None if name == NAME else ["map.npz"])
