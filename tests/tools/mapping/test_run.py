"""Many recordings: what is finished is kept, whoever does the rest."""

import json
import os
import shutil
import time
from pathlib import Path

import pytest

from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.errors import TbmSlamError
from tbmslam.parallel.executor import Executor
from tests.end_to_end.programs import contents
from tools import build_maps, make_world
from tools.mapping import run as mapping_run
from tools.mapping.run import map_all
from tools.mapping.task import Mapped, MappingTask, Shelf


def robot(name: str) -> MappingTask:
    return MappingTask(name, (), (), SlamConfig(), None, None, Path(name))


def dying_over_the_second(task: MappingTask) -> Mapped:
    """Map all but one, over which the process dies when the others are finished."""
    if task.name == "robot_1":
        time.sleep(1.0)
        os._exit(9)
    return Mapped({"robot": task.name})


def test_a_worker_that_dies_costs_its_robot_only(monkeypatch):
    monkeypatch.setattr(mapping_run, "_map_elsewhere", dying_over_the_second)
    tasks = [robot(f"robot_{k}") for k in range(3)]
    done = []

    def work():
        done.extend(task.name for task, made in map_all(tasks, Shelf(), Executor(2)) if made.run)

    said = r"^1 of 3 robots failed \(robot_1\), the others are kept.*; the first: a worker process died, .*--workers$"
    with pytest.raises(TbmSlamError, match=said):
        work()
    assert done == ["robot_0", "robot_2"]


pytestmark = pytest.mark.xdist_group("mapping run")


def run(*arguments):
    return build_maps.main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    small = ["--beams", "91", "--rate", "4", "--duration", "8"]
    assert make_world.main(["--world", "apartment", "--robots", "3", *small, "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def mapped(bags, tmp_path_factory):
    """The maps of a directory of recordings, made in one go."""
    out = tmp_path_factory.mktemp("maps") / "all"
    assert run(bags, "--separate", "-o", out) == 0
    return out


@pytest.fixture
def names_mapped(monkeypatch):
    """Names of the robots that are really mapped, as it goes on."""

    names, really = [], mapping_run.map_robot

    def noting(task, shelf, progress):
        names.append(task.name)
        return really(task, shelf, progress)

    monkeypatch.setattr(mapping_run, "map_robot", noting)
    return names


def results(folder):
    """Everything but the report, which tells what was typed and how long it took."""
    return {name: data for name, data in contents(folder).items() if name != "report.html"}


def test_a_directory_is_the_recordings_in_it(mapped):
    assert [path.name for path in sorted(mapped.glob("robot_*"))] == ["robot_0", "robot_1", "robot_2"]
    run_record = json.loads((mapped / "robot_1" / "run.json").read_text())
    (file,) = run_record["recording"]["files"]
    assert (file["name"], len(file["sha256"])) == ("robot_1.bag", 64)
    assert "paths" not in run_record["recording"]


def test_what_is_finished_is_kept(bags, tmp_path, names_mapped, capsys):
    assert run(bags / "robot_0.bag", "-o", tmp_path) == 0
    before = results(tmp_path)
    assert run(bags / "robot_0.bag", "-o", tmp_path) == 0
    assert "robot_0: 32 scans" in capsys.readouterr().out
    assert names_mapped == ["robot_0"]
    assert run(bags / "robot_0.bag", "-o", tmp_path, "--redo") == 0
    assert names_mapped == ["robot_0"] * 2
    assert results(tmp_path) == before
    for change in (("--set", "map.resolution=0.1"), ("--seed", 3), ("--range-max", 9), ("--frames", "odometry")):
        assert run(bags / "robot_0.bag", "-o", tmp_path, *change) == 0
    assert names_mapped == ["robot_0"] * 6


def test_a_stopped_run_continues(bags, mapped, tmp_path, names_mapped, monkeypatch):
    assert run(bags / "robot_0.bag", bags / "robot_1.bag", "--separate", "-o", tmp_path) == 0
    (tmp_path / "robot_1" / "SHA256SUMS").unlink()  # as if stopped while it saved
    assert run(bags, "--separate", "-o", tmp_path) == 0
    assert names_mapped == ["robot_0", "robot_1", "robot_1", "robot_2"]
    assert results(tmp_path) == results(mapped)


def test_a_stopped_run_of_a_split_recording_continues(bags, tmp_path, names_mapped):
    split = (bags / "robot_0.bag", "--robots", 2, "-o", tmp_path)
    assert run(*split) == 0
    before = results(tmp_path)
    (tmp_path / "robot_0_1" / "map.npz").unlink()
    assert run(*split) == 0
    assert names_mapped == ["robot_0_0", "robot_0_1", "robot_0_1"]
    assert results(tmp_path) == before
    assert run(*split, "--overlap", 0.5) == 0
    assert names_mapped[3:] == ["robot_0_0", "robot_0_1"]


@pytest.mark.parametrize("name", ["map.pgm", "trajectory.tum", "run.json", "SHA256SUMS"])
def test_a_changed_byte_is_noticed_and_the_map_made_again(bags, mapped, tmp_path, names_mapped, capsys, name):
    shutil.copytree(mapped, tmp_path, dirs_exist_ok=True)
    changed = tmp_path / "robot_1" / name
    content = bytearray(changed.read_bytes())
    content[len(content) // 2] ^= 0x01
    changed.write_bytes(content)
    assert run(bags, "--separate", "-o", tmp_path) == 0
    assert names_mapped == ["robot_1"]
    assert results(tmp_path) == results(mapped)


def test_changed_files_are_named_before_they_are_written_again(bags, tmp_path, caplog):
    assert run(bags / "robot_0.bag", "-o", tmp_path) == 0
    (tmp_path / "robot_0" / "map.pgm").write_bytes(b"painted over")
    (tmp_path / "robot_0" / "free.png").unlink()
    assert run(bags / "robot_0.bag", "-o", tmp_path) == 0
    assert "robot_0: changed since an earlier run, written again: free.png, map.pgm" in caplog.text


def test_an_older_truth_does_not_stay(bags, tmp_path):
    split = (bags / "robot_0.bag", "--robots", 2, "-o", tmp_path)
    assert run(*split) == 0
    assert (tmp_path / "truth.json").exists()
    assert run(*split, "--no-truth") == 0
    assert not (tmp_path / "truth.json").exists()


def test_one_bad_recording_does_not_keep_the_others_from_being_mapped(bags, mapped, tmp_path, capsys):
    bad = tmp_path / "bad.bag"
    bad.write_bytes(b"#ROSBAG V2.0\n")
    given = (bags / "robot_0.bag", bad, bags / "robot_2.bag", "--separate", "-o", tmp_path / "out")
    assert run(*given) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("build_maps: 1 of 3 robots failed (bad), the others are kept; correct or omit their ")
    assert str(bad) in error
    for name in ("robot_0", "robot_2"):
        assert results(tmp_path / "out" / name) == results(mapped / name)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "2 maps were made" in page
    assert "1 of 3 robots failed (bad)" in page


def test_one_bad_recording_does_not_keep_the_others_from_being_split(bags, tmp_path, capsys):
    bad = tmp_path / "bad.bag"
    bad.write_bytes(b"#ROSBAG V2.0\n")
    split = ("--separate", "--split", "gaps", "-o", tmp_path / "out")
    assert run(bags / "robot_0.bag", bad, bags / "robot_2.bag", *split) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("build_maps: 1 of 3 robots failed (bad_0), the others are kept; correct or omit their ")
    assert str(bad) in error
    assert sorted(path.name for path in (tmp_path / "out").iterdir() if path.is_dir()) == ["robot_0_0", "robot_2_0"]


def test_other_recordings_are_not_mentioned_if_all_are_bad(tmp_path, capsys):
    for name in ("a.bag", "b.bag"):
        (tmp_path / name).write_bytes(b"#ROSBAG V2.0\n")
    assert run(tmp_path, "--separate", "-o", tmp_path / "out") == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("build_maps: 2 of 2 robots failed (a, b); correct or omit their recordings")


def test_where_a_recording_is_bad_the_others_keep_their_own_truth(bags, mapped, tmp_path):
    bad = tmp_path / "bad.bag"
    bad.write_bytes(b"#ROSBAG V2.0\n")
    truths = [bags / f"robot_{number}.truth.tum" for number in (0, 0, 2)]
    given = (bags / "robot_0.bag", bad, bags / "robot_2.bag", "--separate", "--reference", *truths)
    assert run(*given, "-o", tmp_path / "out") == 1
    told = json.loads((tmp_path / "out" / "truth.json").read_text())["robots"]
    assert {name: one["reference"] for name, one in told.items()} == {
        "robot_0": "robot_0.truth.tum",
        "robot_2": "robot_2.truth.tum",
    }


@pytest.mark.slow
def test_workers_make_the_same_bytes(bags, mapped, tmp_path):
    assert run(bags, "--separate", "-o", tmp_path / "all", "--workers", 2) == 0
    assert results(tmp_path / "all") == results(mapped)
    split = (bags / "robot_0.bag", "--robots", 2)
    for name, workers in (("one", 1), ("two", 2)):
        assert run(*split, "-o", tmp_path / name, "--workers", workers) == 0
    assert results(tmp_path / "one") == results(tmp_path / "two")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--workers", "0"), "--workers: must be a whole number of at least 1, got '0'"),
        (("--workers", "2", "--scheduler", "tcp://127.0.0.1:1"), "a --scheduler has its own workers: drop --workers"),
    ],
)
def test_wrong_numbers_of_workers(words, message, usage_error):
    assert message in usage_error(run, "x.bag", *words)
