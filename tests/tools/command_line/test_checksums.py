import os
import shutil
import subprocess

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.map_folder import save_map
from tbmslam.map.tbm_map import TbmMap
from tools.command_line.checksums import NAME, changed_files, write_checksums


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
