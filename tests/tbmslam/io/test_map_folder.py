"""A robot's folder: what is in it, and that it comes back."""

import os
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import FileNotWrittenError
from tbmslam.io.map_folder import files_of_map, load_map, map_files, remove_map, save_map
from tbmslam.io.tbm_dump import write_tbm_dump
from tbmslam.io.trajectory_file import read_tum
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.map_check import MapFileError
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan
from tests.processes import python

EVO_TRAJ = Path(sys.executable).with_name("evo_traj")
PICTURES = {"pignistic.png", "occupied.png", "free.png", "unknown.png", "conflict.png", "pignistic.pgw"}


def some_grid():
    masses = np.zeros((6, 8, 4), dtype=np.float32)
    masses[...] = (0.0, 0.0, 0.0, 1.0)
    masses[1:5, 1:6] = (0.02, 0.9, 0.03, 0.05)
    masses[1:5, 6] = (0.1, 0.05, 0.8, 0.05)
    masses[0, 0] = (0.0, 0.02, 0.0, 0.98)
    return TbmGrid(GridGeometry(0.05, -1.2345678901234, 3.3, 6, 8), masses)


def some_drive(name="robot_0", poses=3):
    stamps = 1.3e9 + 0.05 * np.arange(poses)
    trajectory = Trajectory(stamps, np.column_stack([0.1 * np.arange(poses), np.zeros(poses), np.full(poses, 3.1)]))
    scan = LaserScan(1.3e9, -1.0, 0.5, 0.1, 30.0, np.array([1.0, np.inf, np.nan, 2.5]))
    return Drive(name, trajectory, Keyframes.from_scans([scan], [SE2(0.0, 0.0, 3.1)], [SE2(0.2, 0.0, 0.0)]))


def some_map(*drives):
    return TbmMap(some_grid(), drives, {"program": "test", "config": {"seed": 3}})


def names(folder):
    return {path.name for path in folder.iterdir()}


def assert_same_map(first, second):
    assert first.grid.geometry == second.grid.geometry
    np.testing.assert_array_equal(first.grid.masses, second.grid.masses)
    assert first.provenance == second.provenance
    assert [drive.name for drive in first.drives] == [drive.name for drive in second.drives]
    for one, other in zip(first.drives, second.drives, strict=True):
        for part in ("trajectory", "keyframes"):
            for field, values in vars(getattr(one, part)).items():
                np.testing.assert_array_equal(values, getattr(getattr(other, part), field))


def test_a_folder_holds_every_format_and_nothing_else(tmp_path):
    save_map(tmp_path / "out" / "robot_0", some_map(some_drive()))
    assert names(tmp_path / "out" / "robot_0") == {"map.npz", "map.yaml", "map.pgm", "trajectory.tum"} | PICTURES


@pytest.mark.parametrize("drives", [(), (some_drive(),), (some_drive("a"), some_drive("b", 5))])
@pytest.mark.parametrize("file", ["", "map.npz"])
def test_a_saved_map_is_loaded_unchanged(tmp_path, drives, file):
    tbm_map = some_map(*drives)
    save_map(tmp_path, tbm_map)
    assert_same_map(load_map(tmp_path / file), tbm_map)
    assert_same_map(load_map(str(tmp_path / file)), tbm_map)


def test_the_same_map_gives_the_same_bytes(tmp_path):
    for folder in ("one", "two", "one"):
        save_map(tmp_path / folder, some_map(some_drive()))
    for name in names(tmp_path / "one"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_several_drives_have_a_file_each(tmp_path):
    drives = [some_drive("robot_0", 2), some_drive("../robot 1", 3), some_drive("ROBOT_0", 4), some_drive("idle", 0)]
    save_map(tmp_path, some_map(*drives))
    lengths = {path.name: len(read_tum(path)) for path in tmp_path.glob("*.tum")}
    assert lengths == {"trajectory_robot_0.tum": 2, "trajectory_.._robot_1.tum": 3, "trajectory_ROBOT_0_2.tum": 4}


def test_trajectories_of_an_older_map_do_not_stay(tmp_path):
    save_map(tmp_path, some_map(some_drive("a"), some_drive("b")))
    (tmp_path / "truth.tum").write_text("1 0 0 0 0 0 0 1\n")
    save_map(tmp_path, some_map(some_drive("a")))
    assert {path.name for path in tmp_path.glob("*.tum")} == {"trajectory.tum", "truth.tum"}


def test_the_ros_map_has_the_occupancy_of_the_masses(tmp_path):
    save_map(tmp_path, some_map())
    picture_only = tmp_path / "elsewhere"
    picture_only.mkdir()
    for name in ("map.yaml", "map.pgm"):
        shutil.copy(tmp_path / name, picture_only)
    for path in (picture_only, picture_only / "map.yaml"):
        again = load_map(path)
        assert again.grid.geometry == some_grid().geometry
        assert again.provenance == {"read_from": "map.yaml"}
        kinds = again.grid.masses.argmax(axis=-1)
        np.testing.assert_array_equal(kinds[1:5, 1:6], FREE)
        np.testing.assert_array_equal(kinds[1:5, 6], OCCUPIED)
        assert kinds[0, 0] == UNKNOWN  # hardly any evidence
        assert (again.grid.masses[5, :, UNKNOWN] == 1.0).all()


def test_the_yaml_keeps_every_digit_of_the_origin(tmp_path):
    save_map(tmp_path, some_map())
    values = yaml.safe_load((tmp_path / "map.yaml").read_text())
    assert values["origin"] == [-1.2345678901234, 3.3, 0.0]
    assert values["free_thresh"] == 0.196


@pytest.mark.parametrize("name", ["old.tbm_map", "OLD.TBM_MAP"])
def test_dumps_are_loaded(tmp_path, name):
    write_tbm_dump(tmp_path / name, some_grid())
    np.testing.assert_array_equal(load_map(tmp_path / name).grid.masses, some_grid().masses)


@pytest.mark.slow
@pytest.mark.skipif(not EVO_TRAJ.exists(), reason="evo is not installed")
def test_evo_takes_the_folder(tmp_path):
    save_map(tmp_path, some_map(some_drive(poses=30)))
    options = "--ros_map_yaml map.yaml --full_check --plot_mode xy --save_plot plot.png"
    done = python(
        EVO_TRAJ, "tum", "trajectory.tum", *options.split(), cwd=tmp_path, HOME=str(tmp_path), MPLBACKEND="Agg"
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"nr. of poses\s+30\b", done.stdout)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nowhere", "nowhere: does not exist"),
        ("empty", r"empty: holds no map\.npz or map\.yaml"),
        ("map.pgm", r"map\.pgm: is a picture.* give its yaml file"),
        ("notes.txt", r"notes\.txt: has an unknown format"),
        ("run.bag", r"run\.bag: is a recording: map its scans with `tbmslam map`"),
    ],
)
def test_what_is_no_map_is_refused(tmp_path, name, message):
    (tmp_path / "empty").mkdir()
    for file in ("map.pgm", "notes.txt", "run.bag"):
        (tmp_path / file).write_text("P5")
    with pytest.raises(MapFileError, match=message):
        load_map(tmp_path / name)


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileNotWrittenError, match="cannot be written"):
        save_map(tmp_path / "file", some_map())


def test_provenance_that_json_cannot_hold_is_a_wrong_argument(tmp_path):
    with pytest.raises(ValueError, match="provenance"):
        save_map(tmp_path, TbmMap(some_grid(), (), {"when": object()}))
    assert names(tmp_path) == set()


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "map.npz")
    with pytest.raises(MapFileError, match="is a device or a pipe"):
        load_map(tmp_path / "map.npz")


def test_the_missing_map_of_a_merge_is_named(tmp_path):
    with pytest.raises(TypeError, match=r"TbmMap, got NoneType: nothing was merged; print the merge for the reasons$"):
        save_map(tmp_path / "map", None)
    with pytest.raises(TypeError, match=r"TbmMap, got TbmGrid$"):
        save_map(tmp_path / "map", some_grid())
    assert list(tmp_path.iterdir()) == []


def test_a_map_without_cells_is_a_wrong_argument(tmp_path):
    with pytest.raises(ValueError, match="tbm_map must have cells, got GridGeometry"):
        save_map(tmp_path / "out", TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 0, 0))))
    assert not (tmp_path / "out").exists()


def test_trajectories_of_other_people_stay(tmp_path):
    (tmp_path / "trajectory_truth.tum").write_text("1 0 0 0 0 0 0 1\n")
    (tmp_path / "map.npz").write_bytes(b"no map")
    save_map(tmp_path, some_map(some_drive("a"), some_drive("b")))
    assert tmp_path / "trajectory_truth.tum" not in map_files(tmp_path)
    remove_map(tmp_path)
    assert names(tmp_path) == {"trajectory_truth.tum"}


def test_the_files_that_are_read_of_a_map_are_known(tmp_path):
    save_map(tmp_path, some_map())
    assert files_of_map(tmp_path) == [tmp_path / "map.npz"]
    assert files_of_map(tmp_path / "map.yaml") == [tmp_path / "map.yaml", tmp_path / "map.pgm"]
    (tmp_path / "map.npz").unlink()
    assert files_of_map(tmp_path) == [tmp_path / "map.yaml", tmp_path / "map.pgm"]
