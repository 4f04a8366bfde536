import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from datasets import DatasetError
from tbmslam.config import ConfigError
from tbmslam.files.map_folder import load_map
from tbmslam.files.tum import TumError, read_tum
from tbmslam.segmentation import SegmentationError
from tools import build_maps, make_world
from tools.mapping.run import OutputError

ROOT = Path(__file__).resolve().parents[2]
QUICK = ("--no-truth",)


def run(*arguments):
    return build_maps.main([str(argument) for argument in arguments])


def run_record(folder):
    return json.loads((folder / "run.json").read_text())


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Two robots that drive for 16 s in a flat, and where they truly were."""
    folder = tmp_path_factory.mktemp("bags")
    small = ["--beams", "181", "--rate", "5", "--duration", "16"]
    arguments = ["--world", "apartment", "--robots", "2", *small, "-o", str(folder)]
    assert make_world.main(arguments) == 0
    return folder


@pytest.fixture(scope="module")
def bag(bags):
    return bags / "robot_0.bag"


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


def test_times_are_told_as_interval_counts_them(tmp_path, caplog):
    """Of a part of a recording, too: what is told of it must name it."""
    small = ["--beams", "181", "--rate", "5", "--duration", "16"]
    world = ["--world", "apartment", "--robots", "1", *small, "--fault", "odometry_jump@10"]
    assert make_world.main([*world, "-o", str(tmp_path / "bags")]) == 0
    assert run(tmp_path / "bags" / "robot_0.bag", "--interval", 5, 15, "-o", tmp_path / "out") == 0
    told = [one for one in run_record(tmp_path / "out" / "robot_0")["incidents"] if "jumps" in one["what"]]
    assert [one["at_s"] for one in told] == [pytest.approx(10.0, abs=0.5)]
    assert any(f"robot_0: at {told[0]['at_s']:.1f} s: the odometry jumps" in line for line in caplog.messages)


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
    assert capsys.readouterr().out.count("  of the whole recording 80 of 80 scans used") == 1
    truth = json.loads((tmp_path / "bag" / "truth.json").read_text())
    found = keys_in(list(truth["robots"].values()))
    for folder in (tmp_path / "log" / "robot_0", tmp_path / "bag" / "robot_1"):
        record = run_record(folder)
        del record["config"], record["versions"]  # the first is described by --print-config
        found |= keys_in(record)
    assert {"T_reference_map", "lost_seconds", "times", "stop"} <= found
    text = (ROOT / "docs" / "run-json.md").read_text(encoding="utf-8")
    assert [key for key in sorted(found) if f"`{key}`" not in text] == []


def test_only_the_robot_that_a_gap_befell_is_told_of_it(tmp_path):
    log = tmp_path / "log.clf"
    ranges = " ".join(["2.0"] * 180)
    stamps = [*range(10), *range(20, 30)]
    log.write_text("".join(f"FLASER 180 {ranges} 0 0 0 0 0 0 {t}.0 host {t}.0\n" for t in stamps))
    intervals = ("--interval", 0, 9, "--interval", 5, 25, "--interval", 20, 30)
    assert run(log, *intervals, "--no-truth", "-o", tmp_path / "out") == 0
    gap = "1 gap without a scan, 11.0 s in all, the longest 11.0 s: what moved meanwhile nobody saw"
    for name, befell in (("robot_0", False), ("robot_1", True), ("robot_2", False)):
        record = run_record(tmp_path / "out" / name)
        assert (gap in record["warnings"]) is befell
        assert ("no scans" in [one["what"] for one in record["incidents"]]) is befell
        assert record["counts"]["gaps"] == 1  # of the whole recording


def test_a_map_holds_what_only_the_end_of_its_drive_tells(bag, tmp_path, monkeypatch):
    monkeypatch.setattr("tbmslam.slam.mount_doubt", lambda *_: "the laser sits elsewhere")
    assert run(bag, "-o", tmp_path) == 0
    record, provenance = run_record(tmp_path / "robot_0"), load_map(tmp_path / "robot_0").provenance
    assert any("the laser sits elsewhere" in warning for warning in record["warnings"])
    assert {name: value for name, value in record.items() if name not in ("result", "fingerprint")} == provenance


def test_the_run_record_says_what_was_done(bag, tmp_path):
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


def test_a_missing_viewer_is_one_line(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert run(bag, "-o", tmp_path, "--viewer") == 1
    said = "build_maps: watching needs rerun-sdk, which is not installed: pip install 'tbmslam[viewer]'\n"
    assert capsys.readouterr().err == said
    with pytest.raises(SystemExit) as stopped:
        run("--viewer", bag, "-o", tmp_path)
    assert stopped.value.code == 2
    assert "--viewer: must end with .rrd, or be the last word" in capsys.readouterr().err


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
    segments = [run_record(tmp_path / f"robot_{k}")["segment"] for k in range(robots)]
    assert len(list(tmp_path.glob("robot_*"))) == robots
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
    assert len({pose.theta for (name, _), pose in starts.items() if name != "odometry"}) == 4
    for robot in ("robot_0", "robot_1"):
        assert starts["odometry", robot] == pytest.approx((0.0, 0.0, 0.0), abs=0.05)


def test_what_is_told_of_the_reference_says_whose_it_is(tmp_path, caplog):
    small = ["--beams", "181", "--rate", "5", "--duration", "16"]
    world = ["--world", "apartment", "--robots", "1", *small, "--fault", "odometry_jump@10"]
    assert make_world.main([*world, "-o", str(tmp_path / "bags")]) == 0
    assert run(tmp_path / "bags" / "robot_0.bag", "--robots", 2, "-o", tmp_path / "out") == 0
    whole = "whole recording, for truth.json: at 10.0 s: the odometry jumps"
    assert any(line.startswith(whole) for line in caplog.messages)


def test_separate_recordings_without_references_have_no_common_truth(bags, tmp_path):
    options = [option for option in QUICK if option != "--no-truth"]
    assert run(bags / "robot_0.bag", bags / "robot_1.bag", "--separate", *options, "-o", tmp_path) == 0
    assert not (tmp_path / "truth.json").exists()


def test_the_seed_of_a_configuration_counts_unless_the_option_says_another(bag, tmp_path):
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


def test_the_truth_says_where_the_maps_lie(bags, bag, tmp_path, capsys):
    assert run(bag, "-o", tmp_path, "--robots", 2, "--reference", bags / "robot_0.truth.tum") == 0
    truth = json.loads((tmp_path / "truth.json").read_text())["robots"]
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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "the following arguments are required: RECORDING"),
        (("a", "b", "--reference", "a.tum", "b.tum"), "--reference needs one trajectory for each recording"),
        (("a", "b", "--separate", "--reference", "a.tum"), "--reference needs one trajectory for each recording"),
        (("a", "--separate", "--robots", "2"), "--separate makes each recording one robot: drop --robots"),
        (("a", "--separate", "--interval", "0", "1"), "--separate makes each recording one robot"),
        (("a", "--robots", "0"), "--robots must be at least 1"),
        (("a", "--robots", "10001"), "--robots must be at least 1 and at most 10000"),
        (("a", "--robots", "2.5"), "invalid int value: '2.5'"),
        (("", "-o", "x"), "an empty text names no file: is a variable of the shell unset?"),
        (("a", "-o", ""), "an empty text names no file: is a variable of the shell unset?"),
        (("a", "--sensor-pose", "nan", "0", "0"), "sensor_pose must be finite and within 1000 m"),
        (("a", "--range-min", "5", "--range-max", "2"), "range_min must be below range_max"),
        (("a", "--overlap", "1"), "--overlap within [0, 1)"),
        (("a", "--overlap", "nan"), "--overlap within [0, 1)"),
        (("a", "--seed", "-1"), "--seed not negative"),
        (("a", "--split", "colour"), "invalid choice: 'colour'"),
        (("a", "--range-max", "-3"), "range_max must be positive, got -3.0"),
        (("a", "--gap", "0"), "gap_s must be positive, got 0.0"),
        (("a", "--odom-frame", ""), "names of topics and frames must not be empty: is a variable of the shell unset?"),
        (("a", "--tf-topic", ""), "names of topics and frames must not be empty"),
        (("a", "--config", ""), "an empty text names no file: is a variable of the shell unset?"),
    ],
)
def test_wrong_usage_is_exit_2(capsys, arguments, message):
    with pytest.raises(SystemExit) as left:
        run(*arguments)
    assert left.value.code == 2
    assert message in capsys.readouterr().err


def errors(bag, tmp_path):
    """Return what can be wrong: arguments, the kind of error, what its line says."""
    broken, wrong, robots = tmp_path / "broken.toml", tmp_path / "wrong.toml", tmp_path / "robots"
    broken.write_text("[map\n")
    wrong.write_text("[map]\nresolutoin = 0.1\n")
    latin = tmp_path / "latin.toml"
    latin.write_bytes("name = 'K\u00f6ln'".encode("latin-1"))
    deep, digits, pipe = tmp_path / "deep.toml", tmp_path / "digits.toml", tmp_path / "pipe.bag"
    deep.write_text("seed = " + "[" * 5000)
    digits.write_text("seed = " + "9" * 5000)
    os.mkfifo(pipe)
    (robots / "robot_5").mkdir(parents=True)
    (tmp_path / "bad.tum").write_text("1 2 3\n")
    nowhere = tmp_path / "nowhere.bag"
    return {
        "no such bag": ((nowhere,), DatasetError, rf"{nowhere}: no such file or directory"),
        "no such preset": ((bag, "--preset", "vinny"), ConfigError, "there is no preset 'vinny'.*did you mean 'viny'"),
        "no such file of parameters": ((bag, "--config", tmp_path / "no.toml"), ConfigError, "cannot be read as TOML"),
        "not TOML": ((bag, "--config", broken), ConfigError, r"broken\.toml: cannot be read as TOML: "),
        "not UTF-8": ((bag, "--config", latin), ConfigError, r"latin\.toml: cannot be read as TOML: "),
        "no such parameter": ((bag, "--config", wrong), ConfigError, r"wrong\.toml: .*did you mean 'map\.resolution'"),
        "no such setting": ((bag, "--set", "map.resolutoin=1"), ConfigError, r"did you mean 'map\.resolution'"),
        "a setting that does not fit": ((bag, "--set", "map.resolution=0"), ConfigError, r"map\.resolution: .*got 0"),
        "another run's robots": ((bag, "-o", robots), OutputError, "robots holds robot_5 of another run: remove it"),
        "an empty interval": ((bag, "--interval", 50, 60), SegmentationError, "no reading lies between 50 s and 60 s"),
        "too many robots": ((bag, "--robots", 60), SegmentationError, "80 readings are too few for 60 robots"),
        "no such topic": ((bag, "--scan-topic", "/scan"), DatasetError, "/base_scan"),
        "lists in lists": ((bag, "--config", deep), ConfigError, r"deep\.toml: cannot be read as TOML: .*recursion"),
        "a number without end": ((bag, "--config", digits), ConfigError, r"digits\.toml: cannot be .*4300 digits"),
        "a text for a number": ((bag, "--set", "seed='1'"), ConfigError, "--set: seed must be a number, got '1'"),
        "cells of no size": ((bag, "--set", "map.resolution=1e-12"), ConfigError, r"map\.resolution: .*got 1e-12"),
        "a pipe": ((pipe,), DatasetError, r"pipe\.bag: is no file but a device or a pipe"),
        "no truth": ((bag, "--reference", tmp_path / "bad.tum"), TumError, r"bad\.tum"),
    }


CASES = [
    *("no such bag", "no such preset", "no such file of parameters", "not TOML", "not UTF-8", "no such parameter"),
    *("no such setting", "a setting that does not fit", "another run's robots", "an empty interval"),
    *("too many robots", "no such topic", "lists in lists", "a number without end", "a text for a number"),
    *("cells of no size", "a pipe", "no truth"),
]


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_one_line_and_exit_1_and_with_debug_an_error(bag, tmp_path, capsys, case):
    cases = errors(bag, tmp_path)
    assert sorted(cases) == sorted(CASES)
    arguments, kind, message = cases[case]
    out = () if "-o" in arguments else ("-o", tmp_path / "out")
    assert run(*arguments, *out) == 1
    said = capsys.readouterr().err
    assert said.startswith("build_maps: ")
    assert said.count("\n") == 1
    with pytest.raises(kind, match=message):
        run(*arguments, *out, "--debug")


def test_a_place_that_cannot_be_written_is_one_line(bag, tmp_path, capsys):
    (tmp_path / "file").touch()
    assert run(bag, "-o", tmp_path / "file") == 1
    assert capsys.readouterr().err.startswith(f"build_maps: {tmp_path / 'file'}")


@pytest.mark.parametrize(
    ("arguments", "end"),
    [
        (("x" * 300,), "File name too long: check that name, or choose another\n"),
        (("x" * 300, "--separate"), "File name too long: check that name, or choose another\n"),
        (("-o", "x" * 300), "cannot be written into (File name too long): choose another folder with -o\n"),
    ],
)
def test_a_name_too_long_is_one_line(bag, tmp_path, capsys, arguments, end):
    long = [tmp_path / word if word.startswith("x") else word for word in arguments]
    assert run(*long, *([bag] if "-o" in arguments else ["-o", tmp_path / "out"])) == 1
    said = capsys.readouterr().err
    assert said.startswith("build_maps: ")
    assert said.endswith(end)
    assert said.count("\n") == 1


def test_a_file_where_a_robot_goes_is_kept(bag, tmp_path, capsys):
    (tmp_path / "robot_0").write_text("precious")
    assert run(bag, "-o", tmp_path) == 1
    assert re.fullmatch(r"build_maps: \S+robot_0\S*: .*Not a directory.*\n", capsys.readouterr().err)
    assert (tmp_path / "robot_0").read_text() == "precious"


def test_scans_that_show_nothing_are_one_line(bag, tmp_path, capsys):
    assert run(bag, "-o", tmp_path / "out", "--range-max", "1e-6") == 1
    assert capsys.readouterr().err == (
        "build_maps: robot_0: nothing is seen in 80 scans (beams: 100% no_return): check --range-max and --range-min, "
        "or choose another --scan-topic\n"
    )
    assert not (tmp_path / "out").exists()


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


def test_a_robot_of_one_scan_has_no_truth_and_costs_no_other(bag, tmp_path, caplog):
    assert run(bag, "-o", tmp_path, "--interval", 0, 10, "--interval", 10.01, 10.25) == 0
    assert list(json.loads((tmp_path / "truth.json").read_text())["robots"]) == ["robot_0"]
    assert "robot_1: it is not known where its map lies: only " in caplog.text


def test_a_second_run_replaces_the_robots_of_the_first(bag, tmp_path):
    assert run(bag, "-o", tmp_path, "--robots", 2, *QUICK) == 0
    before = (tmp_path / "robot_1" / "map.npz").read_bytes()
    assert run(bag, "-o", tmp_path, "--robots", 2, "--overlap", 0.8, *QUICK) == 0
    assert (tmp_path / "robot_1" / "map.npz").read_bytes() != before


def test_help_loads_nothing_heavy():
    code = "import sys; from tools.build_maps import parser; parser().format_help(); print('numpy' in sys.modules)"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)  # noqa: S603 - a fixed command
    assert done.stdout == "False\n"
