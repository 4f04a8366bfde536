"""Whenever writing ends, and however, a map's file is the old one or the new one."""

import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tbmslam.atomic_file import FileNotWrittenError, write_bytes
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.map_check import MapFileError
from tbmslam.map_file import read_map_file, write_map_file
from tbmslam.map_folder import load_map
from tbmslam.tbm_map import TbmMap

ROOT = Path(__file__).resolve().parents[2]

WRITE_FOR_EVER = """
import sys
import numpy as np
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.map_folder import save_map
from tbmslam.tbm_map import TbmMap
maps = []
for name, cell in (("old", (0, 1, 0, 0)), ("new", (0, 0, 1, 0))):
    masses = np.tile(np.array(cell, np.float32), (200, 200, 1))
    maps.append(TbmMap(TbmGrid(GridGeometry(0.05, 0.0, 0.0, 200, 200), masses), (), {"name": name}))
save_map(sys.argv[1], maps[0])
print("ready", flush=True)
while True:
    for one in maps[::-1]:
        save_map(sys.argv[1], one)
"""


def test_a_killed_writer_leaves_a_whole_map(tmp_path):
    folder = tmp_path / "map"
    for attempt in range(6):
        command = [sys.executable, "-c", WRITE_FOR_EVER, str(folder)]
        writer = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE)  # noqa: S603 - a fixed command
        assert writer.stdout is not None
        writer.stdout.readline()
        time.sleep(0.013 * attempt)  # somewhere in the writing
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        writer.stdout.close()
        whole = load_map(folder)
        sure = {"old": 1, "new": 2}[str(whole.provenance["name"])]
        assert np.all(whole.grid.masses[..., sure] == 1.0)
        assert load_map(folder / "map.yaml").grid.masses.shape == (200, 200, 4)


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX")
def test_a_full_disk_keeps_the_old_file(tmp_path, monkeypatch):
    target = tmp_path / "map.npz"
    write_bytes(target, b"old")
    # A limit on files' size fails as a full disk does: in the middle of writing.
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(FileNotWrittenError, match="choose another place or make room"):
            write_bytes(target, b"new" * 1000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert target.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["map.npz"]


def test_a_disk_without_room_is_told(tmp_path, monkeypatch):
    def no_room(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", no_room)
    with pytest.raises(FileNotWrittenError, match=r"map\.npz: cannot be written \(No space left on device\)"):
        write_bytes(tmp_path / "map.npz", b"new")
    assert not list(tmp_path.iterdir())


def test_ctrl_c_keeps_the_old_file(tmp_path, monkeypatch):
    target = tmp_path / "map.npz"
    write_bytes(target, b"old")

    def interrupted(descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(target, b"new")
    assert target.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["map.npz"]


def test_every_changed_byte_is_noticed_or_changes_nothing(tmp_path):
    masses = np.random.default_rng(2).dirichlet(np.ones(4), size=(3, 5)).astype(np.float32)
    whole = TbmMap(TbmGrid(GridGeometry(0.05, 1.0, 2.0, 3, 5), masses), (), {"seed": 7})
    path = tmp_path / "map.npz"
    write_map_file(path, whole)
    content = path.read_bytes()
    noticed = 0
    for index in range(0, len(content), 3):
        path.write_bytes(content[:index] + bytes([content[index] ^ 0x11]) + content[index + 1 :])
        try:
            read = read_map_file(path)
        except MapFileError:
            noticed += 1
            continue
        np.testing.assert_array_equal(read.grid.masses, masses)
        assert read.grid.geometry == whole.grid.geometry
        assert read.provenance == whole.provenance
    assert noticed > len(content) // 3 // 2
