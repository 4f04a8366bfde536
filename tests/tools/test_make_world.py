import json

import cv2
import numpy as np
import pytest

from datasets import open_recording
from datasets.synthetic.buildings import WORLDS as BUILT
from datasets.synthetic.world.world import load_world
from tools.command_line.output_folder import OutputError, output_folder
from tools.make_world import WORLDS, main

SHORT = ["--duration", "3", "--beams", "180"]


def run(*arguments):
    return main([str(argument) for argument in arguments])


def test_a_run_writes_bags_truth_and_a_picture(tmp_path, capsys):
    assert run("--world", "office", "--seed", 1, "--robots", 2, *SHORT, "-o", tmp_path / "office") == 0
    names = sorted(path.name for path in (tmp_path / "office").iterdir())
    assert names == [
        *("robot_0.bag", "robot_0.truth.tum", "robot_1.bag", "robot_1.truth.tum"),
        *("truth.json", "world.npz", "world.png"),
    ]
    truth = json.loads((tmp_path / "office" / "truth.json").read_text())
    assert [robot["scans"] for robot in truth["robots"]] == [60, 60]
    assert truth["odometry"]["preset"] == "good"
    assert load_world(tmp_path / "office").name == "office"
    picture = cv2.imread(str(tmp_path / "office" / "world.png"))
    assert picture.shape[1] > 900
    assert (picture == 255).mean() > 0.8
    assert "robot_1.bag: 60 scans" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_the_projects_own_reader_reads_what_was_written(tmp_path, kind):
    mount = ["--mount", "-0.1", "0.05", "90", "--upside-down", "--no-return", "inf"]
    assert run("--world", "apartment", *SHORT, *mount, "--format", kind, "--odometry", "none", "-o", tmp_path) == 0
    truth = np.loadtxt(tmp_path / "robot_0.truth.tum")
    readings = list(open_recording([tmp_path / ("robot_0.bag" if kind == "ros1" else "robot_0")]))
    assert len(readings) == len(truth) == 60
    assert [reading.scan.stamp for reading in readings] == pytest.approx(truth[:, 0].tolist(), abs=1e-6)
    assert readings[0].T_robot_sensor == pytest.approx((-0.1, 0.05, np.pi / 2))
    assert readings[0].scan.angle_increment < 0
    driven = np.hypot(*np.diff([reading.T_odom_robot[:2] for reading in readings], axis=0).T).sum()
    assert driven == pytest.approx(np.hypot(*np.diff(truth[:, 1:3], axis=0).T).sum(), abs=1e-5)


def test_two_runs_give_the_same_bytes_and_another_drive_seed_another_drive(tmp_path):
    for name, more in (("a", []), ("b", []), ("c", ["--drive-seed", 9])):
        assert run("--world", "apartment", "--seed", 2, *SHORT, *more, "-o", tmp_path / name) == 0
    files = {name: {p.name: p.read_bytes() for p in (tmp_path / name).iterdir()} for name in "abc"}
    assert files["a"] == files["b"]
    assert files["a"]["world.npz"] == files["c"]["world.npz"]
    assert files["a"]["robot_0.bag"] != files["c"]["robot_0.bag"]


def test_worlds_offered_are_worlds_built():
    assert WORLDS == BUILT


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--format", "mcap", "--compression", "bz2"], "--compression is for ROS 1 bags"),
        (["--robots", "0"], "robots must be at least 1 and at most 1000, got 0"),
        (["--robots", "1000000"], "robots must be at least 1 and at most 1000, got 1000000"),
        (["--duration", "0.001"], "a drive must last at least 0.007 s for one scan, got 0 s"),
        (["--rate", "inf"], "rate must be at most 10000 Hz"),
        (["--no-return", "1"], "--no-return must differ from every range that the laser may measure, got 1"),
        (["--no-return", "0", "--rings", "4"], "--no-return is for scans; drop it or --rings"),
        (["--drive-seed", "-1"], "--drive-seed: must be a whole number of at least 0, got '-1'"),
        ([*SHORT, "--fault", "people@60"], "--fault people must begin within the 3.0 s of robot_0, got 60"),
        ([*SHORT, "--fault", "carried@0+999"], "a fault must leave at least one scan: shorten it"),
        (["-o", ""], "the name of a file is empty: is a variable of the shell unset?"),
        (["--beams", "0"], "beams must be positive, got 0"),
        (["--world", "castle"], "invalid choice: 'castle'"),
    ],
)
def test_wrong_usage_is_exit_2(tmp_path, usage_error, arguments, message):
    assert message in usage_error(run, "-o", tmp_path / "out", "--world", "apartment", *arguments)
    assert not (tmp_path / "out").exists()


def test_two_runs_do_not_write_into_one_folder(tmp_path, capsys):
    with output_folder(tmp_path):
        assert run(*SHORT, "-o", tmp_path) == 1
    assert "another run is writing there" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_one_line_and_exit_1(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert run(*SHORT, "-o", tmp_path / "file" / "out") == 1
    error = capsys.readouterr().err
    assert error.startswith("make_world: ")
    assert error.count("\n") == 1
    with pytest.raises(OutputError, match="file"):
        run(*SHORT, "-o", tmp_path / "file" / "out", "--debug")
