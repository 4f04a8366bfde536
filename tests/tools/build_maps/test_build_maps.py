import json
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from tbmslam.geometry.se2 import compose
from tbmslam.io.map_folder import load_map
from tbmslam.io.trajectory_file import read_tum
from tests.tools.build_maps.built_maps import QUICK, run, run_record
from tools import evaluate, make_world

ROOT = Path(__file__).resolve().parents[3]


def test_one_bag_is_one_robot(bag, tmp_path, capsys):
    assert run(bag, "-o", tmp_path) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "robot_0"]
    assert sorted(path.name for path in (tmp_path / "robot_0").iterdir()) == [
        *("SHA256SUMS", "config.toml", "conflict.png", "free.png", "map.npz", "map.pgm", "map.yaml", "occupied.png"),
        *("pignistic.pgw", "pignistic.png", "run.json", "trajectory.tum", "unknown.png"),
    ]
    out = capsys.readouterr().out
    assert "robot_0: 80 scans, " in out
    assert f" -> {tmp_path / 'robot_0'}" in out
    assert "80 of 80 scans used" in out
    assert "  scans: /base_scan; odometry: tf, odom_combined -> base_footprint\n" in out


def test_times_count_as_those_of_interval(tmp_path, caplog):
    """Of a part of a recording, too: what is told of it must name it."""
    small = ["--beams", "181", "--rate", "5", "--duration", "16"]
    world = ["--world", "apartment", "--robots", "1", *small, "--fault", "odometry_jump@10"]
    assert make_world.main([*world, "-o", str(tmp_path / "bags")]) == 0
    assert run(tmp_path / "bags" / "robot_0.bag", "--interval", 5, 15, "-o", tmp_path / "out") == 0
    told = [one for one in run_record(tmp_path / "out" / "robot_0_0")["incidents"] if "disagree" in one["what"]]
    assert [one["at_s"] for one in told] == [pytest.approx(10.0, abs=0.5)]
    line = f"robot_0_0: at {told[0]['at_s']:.1f} s: odometry and scans disagree about the motion"
    assert line in caplog.messages


def keys_in(value):
    """All names in a record, however deep."""
    if isinstance(value, dict):
        return value.keys() | set().union(*map(keys_in, value.values()))
    return set().union(*map(keys_in, value)) if isinstance(value, list) else set()


def test_every_key_is_described(bag, bags, tmp_path, capsys):
    log = tmp_path / "log.clf"
    ranges = " ".join(["2.0"] * 180)
    log.write_text("".join(f"FLASER 180 {ranges} 0 0 0 0 0 0 {k}.0 host {k}.0\n" for k in range(20)))
    assert run(log, "-o", tmp_path / "log") == 0
    split = (bag, "--robots", 2, "--overlap", 0.5, "--reference", bags / "robot_0.truth.tum")
    assert run(*split, "-o", tmp_path / "bag") == 0
    out = capsys.readouterr().out
    assert "  scans: FLASER; odometry: FLASER\n" in out
    assert out.count("  of the whole recording 80 of 80 scans used") == out.count("  scans: /base_scan; ") == 1
    truth = json.loads((tmp_path / "bag" / "truth.json").read_text())
    found = keys_in(list(truth["robots"].values()))
    for folder in (tmp_path / "log" / "log", tmp_path / "bag" / "robot_0_1"):
        record = run_record(folder)
        del record["config"], record["versions"]  # the first is described by --print-config
        found |= keys_in(record)
    assert {"T_reference_map", "lost_seconds", "times", "stop"} <= found
    text = (ROOT / "docs" / "run-json.md").read_text(encoding="utf-8")
    assert [key for key in sorted(found) if f"`{key}`" not in text] == []


def test_the_laser_s_truth_scores_as_the_robot_s(bag, bags, tmp_path, capsys):
    robot = read_tum(bags / "robot_0.truth.tum")
    assert run(bag, "-o", tmp_path / "a", "--reference", bags / "robot_0.truth.tum") == 0
    mounting = load_map(tmp_path / "a" / "robot_0").drives[0].keyframes.mounting()
    assert math.hypot(mounting.x, mounting.y) > 0.05
    lasers = compose(robot.poses, np.array(mounting))
    lines = [f"{round(t * 1e6)}, {x:.9f}, {y:.9f}, {a:.9f}" for t, (x, y, a) in zip(robot.stamps, lasers, strict=True)]
    laser = tmp_path / "robot_0.gt.laser.poses"
    laser.write_text("\n".join(lines))
    assert run(bag, "-o", tmp_path / "b", "--reference", laser) == 0
    ates = [json.loads((tmp_path / one / "truth.json").read_text())["robots"]["robot_0"]["ate_m"] for one in "ab"]
    assert ates[0] == pytest.approx(ates[1], abs=1e-6)
    capsys.readouterr()
    estimate = str(tmp_path / "a" / "robot_0" / "trajectory.tum")
    rmses = []
    for truth in (bags / "robot_0.truth.tum", laser):
        assert evaluate.main(["trajectory", estimate, "--truth", str(truth), "--json"]) == 0
        rmses.append(json.loads(capsys.readouterr().out)["ate_m"]["rmse"])
    assert rmses[0] == pytest.approx(rmses[1], abs=1e-6)
    assert rmses[0] == pytest.approx(ates[0], abs=1e-6)
    alone = tmp_path / "alone.tum"
    alone.write_bytes((tmp_path / "a" / "robot_0" / "trajectory.tum").read_bytes())
    assert evaluate.main(["trajectory", str(alone), "--truth", str(laser)]) == 1
    assert "holds poses of the laser, and no map with keyframes beside" in capsys.readouterr().err
    where = [str(mounting.x), str(mounting.y), str(math.degrees(mounting.theta))]
    assert evaluate.main(["trajectory", str(alone), "--truth", str(laser), "--json", "--sensor-pose", *where]) == 0
    assert json.loads(capsys.readouterr().out)["ate_m"]["rmse"] == pytest.approx(rmses[0], abs=1e-6)


def test_a_map_holds_what_only_the_end_of_its_drive_tells(bag, tmp_path, monkeypatch):
    monkeypatch.setattr("tbmslam.monitoring.drive_review.mount_warning", lambda *_: "the laser sits elsewhere")
    assert run(bag, "-o", tmp_path) == 0
    record, provenance = run_record(tmp_path / "robot_0"), load_map(tmp_path / "robot_0").provenance
    assert any("the laser sits elsewhere" in warning for warning in record["warnings"])
    assert {name: value for name, value in record.items() if name not in ("result", "fingerprint")} == provenance


def test_the_run_record_is_complete(bag, tmp_path):
    assert run(bag, "-o", tmp_path, "--set", "map.resolution=0.1", "--seed", 4) == 0
    record = run_record(tmp_path / "robot_0")
    assert record["program"] == "build_maps"
    assert record["robot"] == "robot_0"
    assert record["recording"]["scan_topic"] == "/base_scan"
    assert record["recording"]["odom_frame"] == "odom_combined"
    assert (record["config"]["seed"], record["config"]["map"]["resolution"]) == (4, 0.1)
    assert record["result"]["scans"] == len(read_tum(tmp_path / "robot_0" / "trajectory.tum")) == 80
    assert (record["result"]["loops_closed"], record["result"]["correction_m"]) == (0, 0.0)
    assert (record["counts"]["scans_read"], record["warnings"]) == (80, [])
    assert record["config"]["map"]["insertion"]["max_range"] is None  # unlimited
    assert record["result"]["duration_s"] == pytest.approx(79 / 5, abs=1e-3)
    made = load_map(tmp_path / "robot_0")
    assert made.grid.geometry.resolution == 0.1
    known = made.grid.is_known().sum() * 0.01
    assert record["result"]["known_area_m2"] == pytest.approx(known)
    # The map itself knows what made it, whatever becomes of run.json.
    assert made.provenance["config"] == record["config"]
    assert made.provenance["versions"] == record["versions"]


def test_mapping_is_watched_into_a_file(bags, tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    both = (bags / "robot_0.bag", bags / "robot_1.bag", "--separate", *QUICK)
    assert run(*both, "-o", tmp_path / "maps", "--viewer", tmp_path / "drives.rrd") == 0
    chunks = pytest.importorskip("rerun.chunk").RrdReader(str(tmp_path / "drives.rrd")).stream()
    assert {f"/robot_{k}/{what}" for k in (0, 1) for what in ("grid", "drive", "robot/scan")} <= {
        chunk.entity_path for chunk in chunks
    }


def test_a_missing_viewer_is_one_line(bag, tmp_path, capsys, monkeypatch, usage_error):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert run(bag, "-o", tmp_path, "--viewer") == 1
    said = "build_maps: watching needs rerun-sdk, which is not installed: pip install 'tbmslam[viewer]'\n"
    assert capsys.readouterr().err == said
    assert "--viewer: must end with .rrd, or be the last word" in usage_error(run, "--viewer", bag, "-o", tmp_path)


def test_an_option_overrides_the_seed_of_a_configuration(bag, tmp_path):
    (tmp_path / "seed.toml").write_text("seed = 7\n")
    chosen = ("--config", tmp_path / "seed.toml")
    for name, more in (("file", ()), ("both", ("--seed", 8))):
        assert run(bag, "-o", tmp_path / name, *chosen, *more) == 0
    seeds = [run_record(tmp_path / name / "robot_0")["config"]["seed"] for name in ("file", "both")]
    assert seeds == [7, 8]
    starts = [read_tum(tmp_path / name / "robot_0" / "trajectory.tum").pose(0) for name in ("file", "both")]
    assert starts[0].theta != starts[1].theta


def test_a_configuration_changes_only_what_it_names(bag, tmp_path):
    toml = tmp_path / "mine.toml"
    toml.write_text("[map]\nresolution = 0.2\n[map.insertion]\nno_return = 'ignore'\n[keyframes]\ndistance = 0.5\n")
    assert run(bag, "-o", tmp_path, "--config", toml, "--set", "keyframes.distance=1.5") == 0
    config = run_record(tmp_path / "robot_0")["config"]
    assert (config["map"]["resolution"], config["map"]["keep_conflict"]) == (0.2, True)
    assert config["map"]["insertion"]["no_return"] == "ignore"
    assert config["keyframes"] == {"distance": 1.5, "angle": 0.25}


@pytest.mark.parametrize(("option", "said"), [("free", "free"), ("drop", "ignore")])
def test_what_no_return_means_reaches_the_map(bag, tmp_path, option, said):
    assert run(bag, "-o", tmp_path, "--no-return", option) == 0
    record = run_record(tmp_path / "robot_0")
    assert record["config"]["map"]["insertion"]["no_return"] == said
    assert record["recording"]["no_return"] == option


@pytest.mark.parametrize("preset", ["viny", "viny-hc"])
def test_presets(bag, tmp_path, preset):
    assert run(bag, "-o", tmp_path, "--preset", preset) == 0
    assert run_record(tmp_path / "robot_0")["config"]["preset"] == preset


def test_a_name_that_is_no_text_is_mapped(bag, tmp_path):
    odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/drive \xff\n.bag"))
    odd.write_bytes(bag.read_bytes())
    assert run(odd, "-o", tmp_path / "out") == 0
    assert r"drive \udcff" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("text", ["[1]", "[" * 100_000, "\xff"])
def test_a_spoilt_record_is_made_again(bag, tmp_path, text):
    assert run(bag, "-o", tmp_path, *QUICK) == 0
    (tmp_path / "robot_0" / "run.json").write_text(text)
    assert run(bag, "-o", tmp_path, *QUICK) == 0
    assert run_record(tmp_path / "robot_0")["robot"] == "robot_0"
