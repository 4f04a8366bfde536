"""What `build_maps` refuses: one line, and an exit code that says whose fault it is."""

import math
import os
import re

import pytest

from datasets import DatasetError
from tbmslam.configuration.slam_config import ConfigError
from tbmslam.errors import TbmSlamError
from tbmslam.io.trajectory_file import TumError
from tbmslam.sensing.segmentation import SegmentationError
from tests.datasets.conftest import BagScript
from tests.tools.build_maps.built_maps import QUICK, run
from tools import convert, edit, merge
from tools.mapping.run import OutputError


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "the following arguments are required: RECORDING"),
        (("a", "b", "--reference", "a.tum", "b.tum"), "--reference needs one trajectory for each recording"),
        (("a", "b", "--separate", "--reference", "a.tum"), "--reference needs one trajectory for each recording"),
        (("a", "--separate", "--robots", "2"), "--robots and --interval cut one drive: drop them or --separate"),
        (("a", "--separate", "--interval", "0", "1"), "--robots and --interval cut one drive: drop them or --separate"),
        (("a", "--robots", "0"), "--robots: must be a whole number within 1 and 10000, got '0'"),
        (("a", "--robots", "10001"), "--robots: must be a whole number within 1 and 10000, got '10001'"),
        (("a", "--robots", "2.5"), "--robots: must be a whole number within 1 and 10000, got '2.5'"),
        (("", "-o", "x"), "the name of a file is empty: is a variable of the shell unset?"),
        (("a", "-o", ""), "the name of a file is empty: is a variable of the shell unset?"),
        (("a", "--sensor-pose", "nan", "0", "0"), "sensor_pose must be finite and within 1000 m"),
        (("a", "--range-min", "5", "--range-max", "2"), "range_min must be below range_max"),
        (("a", "--overlap", "1"), "--overlap must be at least 0 and below 1, got 1"),
        (("a", "--overlap", "nan"), "--overlap must be at least 0 and below 1, got nan"),
        (("a", "--seed", "-1"), "--seed: must be a whole number of at least 0, got '-1'"),
        (("a", "--split", "colour"), "invalid choice: 'colour'"),
        (("a", "--range-max", "-3"), "range_max must be positive, got -3.0"),
        (("a", "--gap", "0"), "gap_s must be positive, got 0.0"),
        (("a", "--odom-frame", ""), "names of topics and frames must not be empty: is a variable of the shell unset?"),
        (("a", "--tf-topic", ""), "names of topics and frames must not be empty"),
        (("a", "--config", ""), "the name of a file is empty: is a variable of the shell unset?"),
    ],
)
def test_wrong_usage_is_exit_2(usage_error, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    for name in "ab":
        (tmp_path / name).touch()
    assert message in usage_error(run, *arguments)


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
    (robots / "robot_5" / "map.npz").touch()
    (tmp_path / "bad.tum").write_text("1 2 3\n")
    nowhere = tmp_path / "nowhere.bag"
    return {
        "no such bag": ((nowhere,), TbmSlamError, rf"{nowhere}: no such file or directory"),
        "no such preset": ((bag, "--preset", "vinny"), ConfigError, "there is no preset 'vinny'.*did you mean 'viny'"),
        "no such file of parameters": (
            (bag, "--config", tmp_path / "no.toml"),
            TbmSlamError,
            "no such file or directory",
        ),
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
        "a pipe": ((pipe,), DatasetError, r"pipe\.bag: is a device or a pipe"),
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
        (("x" * 300,), "File name too long: check the name, or choose another\n"),
        (("x" * 300, "--separate"), "File name too long: check the name, or choose another\n"),
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


def test_a_file_in_the_place_of_a_robot_is_kept(bag, tmp_path, capsys):
    (tmp_path / "robot_0").write_text("precious")
    assert run(bag, "-o", tmp_path) == 1
    assert re.fullmatch(r"build_maps: \S+robot_0\S*: .*Not a directory.*\n", capsys.readouterr().err)
    assert (tmp_path / "robot_0").read_text() == "precious"


@pytest.mark.parametrize(
    ("place", "files", "fact"),
    [
        (".", ("map.npz", "report.json"), r"holds a merged map and its report \(report\.json\), which would be"),
        ("robot_0", ("map.npz", "report.json"), r"holds a merged map \(report\.json\), which would be replaced"),
        ("robot_0", ("map.yaml", "map.pgm"), r"holds map\.yaml, map\.pgm, which would be replaced"),
    ],
)
def test_a_map_of_other_origin_is_not_replaced(bag, tmp_path, capsys, place, files, fact):
    folder = tmp_path / "out" / place
    folder.mkdir(parents=True)
    for name in files:
        (folder / name).write_text("mine")
    assert run(bag, "-o", tmp_path / "out") == 1
    assert re.fullmatch(rf"build_maps: \S+: {fact}.*: choose another folder\n", capsys.readouterr().err)
    assert {file.name: file.read_text() for file in folder.iterdir()} == dict.fromkeys(files, "mine")


@pytest.mark.parametrize(
    ("made_by", "without", "fact"),
    [
        ("edit", (), r"an edited map \(edits\.toml\)"),
        ("edit", ("SHA256SUMS",), r"an edited map \(edits\.toml\)"),
        ("convert", (), r"a converted map \(SHA256SUMS without run\.json\)"),
        ("merge", ("report.json", "report.html", "SHA256SUMS"), r"a merged map \(map\.npz\)"),
    ],
)
def test_a_map_of_another_command_is_not_replaced(bag, folders, tmp_path, capsys, made_by, without, fact):
    out = tmp_path / "out" / "robot_0"
    here, there = str(folders / "here"), str(folders / "there")
    if made_by == "edit":
        assert edit.main([here, "--rotate", "5", "-o", str(out)]) == 0
    elif made_by == "convert":
        assert convert.main([here, str(out)]) == 0
    else:
        assert merge.main([here, there, "-o", str(out)]) == 0
    for name in without:
        (out / name).unlink()
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    capsys.readouterr()
    assert run(bag, "-o", tmp_path / "out", *QUICK) == 1
    said = capsys.readouterr().err
    assert re.fullmatch(rf"build_maps: \S+: holds {fact}, which would be replaced: choose another folder\n", said)
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before


def test_an_unfinished_map_of_the_robot_is_replaced(bag, tmp_path):
    assert run(bag, "-o", tmp_path, *QUICK) == 0
    for name in ("run.json", "SHA256SUMS"):
        (tmp_path / "robot_0" / name).unlink()
    assert run(bag, "-o", tmp_path, *QUICK) == 0
    assert (tmp_path / "robot_0" / "SHA256SUMS").is_file()


def test_a_laser_that_measures_nothing_is_one_line(tmp_path, capsys):
    script = BagScript().tf(100.0, "base_link", "laser", bag_time=99.0).drive(100.0, 108.0)
    for k in range(60):
        script.scan(100.5 + 0.1 * k, [math.inf] * (20 + k % 2))
    assert run(script.in_time_order().write(tmp_path / "blind.bag"), "-o", tmp_path / "out", "--odometry", "none") == 1
    said = capsys.readouterr().err
    assert "longer range" not in said
    assert said.splitlines()[-1] == (
        "build_maps: blind: no beam of 60 scans has a finite range: check the laser and its driver, or choose another "
        "--scan-topic"
    )


def test_scans_that_show_nothing_are_one_line(bag, tmp_path, capsys):
    assert run(bag, "-o", tmp_path / "out", "--range-max", "1e-6") == 1
    assert capsys.readouterr().err == (
        "build_maps: robot_0: nothing was measured in 80 scans (beams: 100% no_return): check --range-max and "
        "--range-min, "
        "or choose another --scan-topic\n"
    )
    assert not (tmp_path / "out").exists()
