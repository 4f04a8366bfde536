"""How recordings become robots: what each is told, where it begins and where its map truly lies."""

import itertools
import json

import numpy as np
import pytest

from tbmslam.io.trajectory_file import read_tum
from tbmslam.sensing.segmentation import private_frame
from tests.datasets.conftest import BagScript
from tests.tools.build_maps.built_maps import QUICK, run, run_record
from tools import make_world


def test_only_the_robot_with_a_gap_has_its_warning(tmp_path):
    log = tmp_path / "log.clf"
    ranges = " ".join(["2.0"] * 180)
    stamps = [*range(10), *range(20, 30)]
    log.write_text("".join(f"FLASER 180 {ranges} 0 0 0 0 0 0 {t}.0 host {t}.0\n" for t in stamps))
    intervals = ("--interval", 0, 9, "--interval", 5, 25, "--interval", 20, 30)
    assert run(log, *intervals, "--no-truth", "-o", tmp_path / "out") == 0
    gap = "1 gap of 11.0 s without a scan: motion during a gap is unknown"
    for name, befell in (("log_0", False), ("log_1", True), ("log_2", False)):
        record = run_record(tmp_path / "out" / name)
        assert (gap in record["warnings"]) is befell
        assert ("no scans" in [one["what"] for one in record["incidents"]]) is befell
        assert record["counts"]["gaps"] == 1  # of the whole recording


@pytest.mark.parametrize(
    ("arguments", "robots"),
    [
        (("--robots", 3), 3),
        (("--robots", 2, "--split", "time", "--overlap", 0), 2),
        (("--interval", 0, 5, "--interval", 4, 12), 2),
        (("--split", "gaps"), 1),
    ],
)
def test_one_bag_is_split(bag, tmp_path, monkeypatch, arguments, robots):
    monkeypatch.setattr("tools.mapping.task.save_map", lambda *_: None)
    assert run(bag, "-o", tmp_path, *QUICK, *arguments) == 0
    segments = [run_record(tmp_path / f"robot_0_{k}")["segment"] for k in range(robots)]
    assert len(list(tmp_path.glob("robot_0_*"))) == robots
    assert segments[0]["start"] == 0
    assert all(before["start"] < after["start"] for before, after in itertools.pairwise(segments))
    shares = segments[0]["stop"] > segments[1]["start"] if robots > 1 else False
    assert shares is (arguments[0] == "--interval" or arguments == ("--robots", 3))


def test_each_robot_has_a_frame_of_its_own_from_the_seed(bags, tmp_path):
    both = (bags / "robot_0.bag", bags / "robot_1.bag", "--separate", *QUICK)
    for seed in (1, 2):
        assert run(*both, "-o", tmp_path / str(seed), "--seed", seed) == 0
    assert run(*both, "-o", tmp_path / "odometry", "--frames", "odometry") == 0
    starts = {
        (run_name, robot): read_tum(tmp_path / run_name / robot / "trajectory.tum").pose(0)
        for run_name in ("1", "2", "odometry")
        for robot in ("robot_0", "robot_1")
    }
    for seed, robot in itertools.product((1, 2), (0, 1)):
        assert starts[str(seed), f"robot_{robot}"] == pytest.approx(private_frame(seed, robot), abs=0.05)
    for robot in ("robot_0", "robot_1"):
        assert starts["odometry", robot] == pytest.approx((0.0, 0.0, 0.0), abs=0.05)


def test_warnings_of_the_reference_have_its_name(tmp_path, caplog):
    small = ["--beams", "181", "--rate", "5", "--duration", "16"]
    world = ["--world", "apartment", "--robots", "1", *small, "--fault", "odometry_jump@10"]
    assert make_world.main([*world, "-o", str(tmp_path / "bags")]) == 0
    assert run(tmp_path / "bags" / "robot_0.bag", "--robots", 2, "-o", tmp_path / "out") == 0
    what = "odometry and scans disagree about the motion"
    whole = f"whole recording, for truth.json: at 10.0 s: {what}"
    assert any(line.startswith(whole) for line in caplog.messages)
    said = json.loads((tmp_path / "out" / "truth.json").read_text())
    assert said["source"] == "tbmslam's own map of the whole recording, not ground truth"
    assert {"recording": "robot_0.bag", "at_s": 10.0, "what": what}.items() <= said["warnings"][0].items()
    repeated = "truth.json is tbmslam's own map of the whole recording, not ground truth, and may be wrong itself"
    for _ in range(2):  # the second run builds nothing again, and reports the same
        assert sum(repeated in line for line in caplog.messages) == 1
        caplog.clear()
        assert run(tmp_path / "bags" / "robot_0.bag", "--robots", 2, "-o", tmp_path / "out") == 0


def test_separate_recordings_without_references_have_no_common_truth(bags, tmp_path):
    options = [option for option in QUICK if option != "--no-truth"]
    assert run(bags / "robot_0.bag", bags / "robot_1.bag", "--separate", *options, "-o", tmp_path) == 0
    assert not (tmp_path / "truth.json").exists()


def test_the_truth_holds_the_poses_of_the_maps(bags, bag, tmp_path, capsys):
    assert run(bag, "-o", tmp_path, "--robots", 2, "--reference", bags / "robot_0.truth.tum") == 0
    said = json.loads((tmp_path / "truth.json").read_text())
    assert (said["source"], said["warnings"]) == ("trajectories given as true", [])
    truth = said["robots"]
    for name, entry in truth.items():
        own = read_tum(tmp_path / name / "trajectory.tum")
        reference = read_tum(bags / "robot_0.truth.tum")
        at = int(np.abs(reference.stamps - own.stamps[0]).argmin())
        x, y, theta = entry["T_reference_map"]
        assert entry["reference"] == "robot_0.truth.tum"
        assert entry["ate_m"] < 0.05
        cosine, sine = np.cos(theta), np.sin(theta)
        start = own.pose(0)
        placed = (x + cosine * start.x - sine * start.y, y + sine * start.x + cosine * start.y)
        assert placed == pytest.approx(reference.pose(at)[:2], abs=0.1)
    assert f"truth for evaluation -> {tmp_path / 'truth.json'}" in capsys.readouterr().out


def test_a_robot_of_one_scan_has_no_truth_and_costs_no_other(bag, tmp_path, caplog):
    assert run(bag, "-o", tmp_path, "--interval", 0, 10, "--interval", 10.01, 10.25) == 0
    assert list(json.loads((tmp_path / "truth.json").read_text())["robots"]) == ["robot_0_0"]
    assert "robot_0_1: the pose of its map is unknown: only " in caplog.text


def test_a_second_run_replaces_the_robots_of_the_first(bag, tmp_path):
    assert run(bag, "-o", tmp_path, "--robots", 2, *QUICK) == 0
    before = (tmp_path / "robot_0_1" / "map.npz").read_bytes()
    assert run(bag, "-o", tmp_path, "--robots", 2, "--overlap", 0.8, *QUICK) == 0
    assert (tmp_path / "robot_0_1" / "map.npz").read_bytes() != before


def test_each_recording_may_have_its_own_topic_of_scans(bags, tmp_path, capsys):
    both = (bags / "robot_0.bag", bags / "robot_1.bag", "--separate", "-o", tmp_path, *QUICK)
    assert run(*both, "--scan-topic", "robot_0=/base_scan", "--scan-topic", "robot_1.bag=/none") == 1
    said = capsys.readouterr().err
    assert "1 of 2 robots failed (robot_1)" in said
    assert "there is no topic /none" in said
    assert run(*both, "--scan-topic", "/none", "--scan-topic", "robot_1=/base_scan") == 1
    assert "1 of 2 robots failed (robot_0)" in capsys.readouterr().err
    assert run(*both, "--scan-topic", "monday=/base_scan") == 1
    assert "--scan-topic monday=/base_scan names no recording: there are robot_0, robot_1" in capsys.readouterr().err


def test_parts_of_recordings_have_different_names(bag, tmp_path):
    other = tmp_path / "robot_0_0.bag"
    other.write_bytes(bag.read_bytes())
    assert run(bag, other, "--separate", "--split", "gaps", "-o", tmp_path / "out", *QUICK) == 0
    named = sorted(path.name for path in (tmp_path / "out").glob("robot_*"))
    assert named == ["robot_0_0", "robot_0_0_0"]


def test_a_failed_robot_is_named_once(bag, tmp_path, caplog):
    blind = BagScript().drive(100.0, 103.0).scan(101.0, [np.nan] * 90).in_time_order().write(tmp_path / "blind.bag")
    assert run(bag, blind, "--separate", "-o", tmp_path / "out", *QUICK) == 1
    (line,) = [message for message in caplog.messages if "none of 1 scan can be used" in message]
    assert line.startswith("blind: none of 1 scan")
