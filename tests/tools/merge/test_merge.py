import json
import math
import shutil
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from merging.config import Coverage, MergeConfig, Method, Rule
from merging.config.registration import Descriptor
from merging.merger import Merge
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io import map_folder
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan
from tests.belief_rules import dempster, disjunctive
from tools import merge


def test_two_maps_become_one_in_a_folder_like_any_other(folders, tmp_path, capsys):
    assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path / "merged")]) == 0
    merged = map_folder.load_map(tmp_path / "merged")
    assert merged.grid.is_known().sum() == pytest.approx(240 * 320, rel=0.03)
    report = json.loads((tmp_path / "merged" / "report.json").read_text())
    assert report["pairs"][0]["accepted"] is True
    x, y, theta = SE2(2.0, 3.0, math.radians(70.0)).inverse()
    assert report["maps"]["there"]["T_merged_map"] == pytest.approx([x, y, theta], abs=0.05)
    assert {
        "report.json",
        "report.html",
        "overlay.png",
        "contradictions.png",
        "conflict.png",
        "map.npz",
        "map.yaml",
        "map.pgm",
    } <= {path.name for path in (tmp_path / "merged").iterdir()}
    said = capsys.readouterr().out
    assert "there in here: accepted: " in said
    assert f"report -> {tmp_path / 'merged' / 'report.html'}" in said


@pytest.mark.parametrize(
    ("options", "rule", "combine"), [([], "disjunctive", disjunctive), (["--rule", "dempster"], "dempster", dempster)]
)
def test_the_cells_follow_the_rule_and_the_report_names_it(folders, tmp_path, options, rule, combine):
    """Of cells that are not certain: where all is, a contradiction is unknown by either rule."""
    for name in ("here", "there"):
        sure = map_folder.load_map(folders / name).grid
        masses = 0.75 * sure.masses + np.float32([0.0, 0.0, 0.0, 0.25])
        map_folder.save_map(tmp_path / name, TbmMap(TbmGrid(sure.geometry, masses)))
    folders = tmp_path
    assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path / "out"), *options]) == 0
    tmp_path /= "out"
    report, merged = json.loads((tmp_path / "report.json").read_text()), map_folder.load_map(tmp_path).grid
    assert report["fusion"]["rule"] == rule
    here, there = (
        resample(map_folder.load_map(folders / name).grid, SE2(*report["maps"][name]["T_merged_map"]), merged.geometry)
        for name in ("here", "there")
    )
    both = here.is_known() & there.is_known()
    differ = np.abs(here.masses - there.masses)[both].max(axis=-1) > 0.5
    assert differ.sum() > 20
    expected = combine(here.masses[both], there.masses[both])
    solved = expected.sum(axis=-1) > 0.5  # of full conflict Dempster's rule says nothing
    np.testing.assert_allclose(merged.masses[both][solved], expected[solved], atol=1e-4)


def test_a_merge_is_merged_with_a_map_file(folders, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(first)]) == 0
    assert merge.main([str(first / "map.npz"), str(folders / "there" / "map.yaml"), "-o", str(second)]) == 0
    assert list(json.loads((second / "report.json").read_text())["maps"]) == ["first", "there"]


def test_a_foreign_map_is_left_out_and_named(folders, tmp_path, capsys):
    names = [str(folders / name) for name in ("foreign", "here", "there")]
    assert merge.main([*names, "-o", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "left out: foreign: no alignment with a merged map was accepted" in said
    assert "if the pose of a map is known, pass --pose NAME X Y DEG, in the first map's frame\n" in said
    assert json.loads((tmp_path / "report.json").read_text())["frame"] == "here"


@pytest.mark.parametrize(("other", "reason"), [("foreign", ""), ("empty", "the source map is empty")])
def test_nothing_to_merge_is_status_3_with_a_report(folders, tmp_path, capsys, other, reason):
    assert merge.main([str(folders / "here"), str(folders / other), "-o", str(tmp_path)]) == 3
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["merged"] is False
    assert reason in report["pairs"][0]["reason"]
    assert not (tmp_path / "map.npz").exists()
    assert f"nothing merged; the reasons are in {tmp_path / 'report.html'}" in capsys.readouterr().out


@pytest.mark.parametrize(("known", "is_asked"), [({}, True), ({"b": (0, 0, 0)}, False), ({"c": (0, 0, 0)}, True)])
def test_a_pose_is_asked_for_unless_it_was_given(tmp_path, capsys, known, is_asked):
    config = MergeConfig.model_validate({"known_poses": known})
    merge._tell(Merge(None, {}, {}, {"a": "too far away", "b": "too far away"}, None), config, "a", tmp_path)
    assert ("pass --pose" in capsys.readouterr().out) is is_asked


@pytest.mark.parametrize(("options", "begin"), [([], "%(message)s"), (["-v"], "%(name)s: %(message)s")])
def test_warnings_name_modules_only_with_verbose(monkeypatch, capsys, options, begin):
    formats = []
    monkeypatch.setattr(merge.logging, "basicConfig", lambda **given: formats.append(given["format"]))
    assert merge.main(["--print-config", *options]) == 0
    assert formats == [begin]
    assert "[merging" in capsys.readouterr().out


def test_a_map_given_twice_causes_a_warning(folders, tmp_path, caplog):
    merge.main([str(folders / "empty"), str(folders / "empty" / "map.npz"), "-o", str(tmp_path / "merged")])
    assert "map.npz: is given twice and counts as two robots" in caplog.text


def test_a_drive_given_under_two_paths_causes_a_warning(tmp_path, caplog):
    scans = [LaserScan(0.1 * k, -1.0, 0.5, 0.1, 30.0, np.full(5, 1.0 + k)) for k in range(6)]
    keyframes = Keyframes.from_scans(scans, *[[SE2.identity()] * 6] * 2)
    drive = Drive("robot", Trajectory(keyframes.stamps, keyframes.poses), keyframes)
    map_folder.save_map(tmp_path / "drive", TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20)), (drive,)))
    shutil.copytree(tmp_path / "drive", tmp_path / "copy")
    merge.main([str(tmp_path / "drive"), str(tmp_path / "copy"), "-o", str(tmp_path / "merged")])
    assert "drive and copy hold the same scans, 6 of 6 keyframes: one drive would count as two robots" in caplog.text


def test_the_options_reach_the_merge(folders, tmp_path):
    chosen = [
        "--method", "features", "--rule", "conjunctive", "--coverage", "overlap", "--keypoints", "800",
        "--ratio", "0.8", "--descriptor", "pignistic", "--min-inliers", "6", "--resolution", "0.1",
        "--compare-at", "0.06",
    ]  # fmt: skip
    merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path), *chosen])
    config = json.loads((tmp_path / "report.json").read_text())["config"]
    assert {key: config[key] for key in ("method", "rule", "coverage", "resolution", "merged_resolution")} == {
        "method": "features",
        "rule": "conjunctive",
        "coverage": "overlap",
        "resolution": 0.06,
        "merged_resolution": 0.1,
    }
    assert (config["features"]["keypoints"], config["features"]["ratio"], config["features"]["descriptor"]) == (
        800,
        0.8,
        "pignistic",
    )
    assert config["consensus"]["min_inliers"] == 6


def test_maps_merged_rigidly_are_not_deformed(folders, tmp_path):
    merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path), "--rigid"])
    config = json.loads((tmp_path / "report.json").read_text())["config"]
    assert not config["nonrigid"]["enabled"]
    assert not config["joint"]["enabled"]


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["out/robot_0", "out/robot_1"], ["robot_0", "robot_1"]),
        (["a/robot_0", "b/robot_0", "b/robot_1"], ["a/robot_0", "b/robot_0", "b/robot_1"]),
        (["robot_0/map.npz", "robot_1/map.yaml", "hall.yaml"], ["robot_0", "robot_1", "hall"]),
        (["robot_0", "robot_0/map.npz"], ["robot_0", "robot_0#2"]),
    ],
)
def test_maps_have_names_of_their_own(paths, names):
    assert merge.unique_names([Path(path) for path in paths]) == names


def test_the_choices_are_the_library_s():
    assert get_args(Method) == merge.METHODS
    assert get_args(Rule) == merge.RULES
    assert get_args(Coverage) == merge.COVERAGES
    assert get_args(Descriptor) == merge.DESCRIPTORS
