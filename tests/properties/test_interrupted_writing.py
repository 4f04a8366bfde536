"""Whenever writing ends, and however, a map's file is the old one or the new one."""

import errno
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.atomic_file import FileNotWrittenError, write_bytes
from tbmslam.io.map_folder import load_map, save_map
from tbmslam.io.map_npz import read_map_file, write_map_file
from tbmslam.map.map_check import MapFileError
from tbmslam.map.tbm_map import TbmMap

ROOT = Path(__file__).resolve().parents[2]

KILL_WHILE_WRITING = """
import os, shutil, signal, sys, time
from pathlib import Path
import numpy as np
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.map_folder import save_map
from tbmslam.map.tbm_map import TbmMap
maps = []
for name, cell in (("old", (0, 1, 0, 0)), ("new", (0, 0, 1, 0))):
    masses = np.tile(np.array(cell, np.float32), (200, 200, 1))
    maps.append(TbmMap(TbmGrid(GridGeometry(0.05, 0.0, 0.0, 200, 200), masses), (), {"name": name}))
folder, parent = Path(sys.argv[1]), os.getpid()
for attempt in range(6):
    save_map(folder / "at", maps[0])
    child = os.fork()
    if not child:
        while os.getppid() == parent:
            for one in maps[::-1]:
                save_map(folder / "at", one)
        os._exit(0)
    time.sleep(0.013 * attempt)  # somewhere in the writing
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    shutil.copytree(folder / "at", folder / f"left-{attempt}")
"""

KILL_AT_EACH_STEP = """
import os, shutil, signal, sys
from itertools import count
from pathlib import Path
import numpy as np
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.map.keyframes import Keyframes
from tbmslam.io.map_folder import remove_map, save_map
from tbmslam.map.drive import Drive
from tbmslam.map.tbm_map import TbmMap
from tbmslam.geometry.trajectory import Trajectory

def a_map(*names):
    poses = Trajectory(np.arange(3.0), np.zeros((3, 3)) + 0.01 * len(names[0]))
    drives = tuple(Drive(name, poses, Keyframes.from_scans([], [], [])) for name in names)
    return TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 4, 5)), drives, {})

folder, steps = Path(sys.argv[1]), {"os.rename", "os.remove", "open"}
place = str(folder)
os.fsync = lambda _: None  # takes long, and is for power cuts
old, kinds = a_map("a", "b"), {"single": a_map("lone"), "several": a_map("b", "long name"), "removed": None}

def change(kind):
    save_map(folder / "at", kinds[kind]) if kinds[kind] else remove_map(folder / "at")

def change_and_die(kind, step):
    seen = 0
    def watch(event, args):
        nonlocal seen
        if event in steps and place in repr(args[0]):
            seen += 1
        if seen == step:
            seen += 1  # killing is an event, too
            os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(watch)
    change(kind)
    os._exit(0)

save_map(folder / "old", old)
for kind in kinds:
    for step in count(1):
        shutil.rmtree(folder / "at", ignore_errors=True)
        shutil.copytree(folder / "old", folder / "at")
        child = os.fork()
        if not child:
            change_and_die(kind, step)
        killed = os.waitpid(child, 0)[1] != 0
        shutil.copytree(folder / "at", folder / f"{kind}-{step}-left")
        change(kind)
        shutil.copytree(folder / "at", folder / f"{kind}-{step}-again")
        if not killed:
            break
"""
"""Kills a writer before each of its steps in turn: files opened, renamed, removed; and keeps what was left."""


def trajectories_in(folder):
    return {path.name: path.read_bytes() for path in folder.glob("trajectory*.tum")}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_no_trajectory_lies_beside_a_map_that_it_does_not_belong_to_whenever_writing_ends(tmp_path):
    subprocess.run([sys.executable, "-c", KILL_AT_EACH_STEP, str(tmp_path)], cwd=ROOT, check=True)  # noqa: S603
    should_be = {None: {}}  # by the bytes of the map, of which few differ
    for kind, least in (("single", 40), ("several", 40), ("removed", 10)):
        left = sorted(tmp_path.glob(f"{kind}-*-left"))
        assert len(left) > least
        for folder in left:
            there = (folder / "map.npz").read_bytes() if (folder / "map.npz").exists() else None
            if there not in should_be:
                save_map(tmp_path / "as it should be" / folder.name, load_map(folder))
                should_be[there] = trajectories_in(tmp_path / "as it should be" / folder.name)
            assert trajectories_in(folder).items() <= should_be[there].items(), folder.name
        finished = trajectories_in(left[-1].with_name(f"{kind}-{len(left)}-left"))
        for folder in tmp_path.glob(f"{kind}-*-again"):
            assert trajectories_in(folder) == finished, folder.name


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_killed_writer_leaves_a_whole_map(tmp_path):
    subprocess.run([sys.executable, "-c", KILL_WHILE_WRITING, str(tmp_path)], cwd=ROOT, check=True)  # noqa: S603
    for attempt in range(6):
        folder = tmp_path / f"left-{attempt}"
        whole = load_map(folder)
        sure = {"old": 1, "new": 2}[str(whole.provenance["name"])]
        assert np.all(whole.grid.masses[..., sure] == 1.0)
        assert load_map(folder / "map.yaml").grid.masses.shape == (200, 200, 4)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_writer_ends_with_its_parent(tmp_path):
    script = KILL_WHILE_WRITING.replace("time.sleep(0.013 * attempt)", "time.sleep(0.1); os._exit(0)")
    # The output is closed when both processes have ended.
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], cwd=ROOT, check=True, capture_output=True, timeout=60)  # noqa: S603
    assert load_map(tmp_path / "at").grid.masses.shape == (200, 200, 4)


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


def test_a_full_disk_is_reported(tmp_path, monkeypatch):
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
