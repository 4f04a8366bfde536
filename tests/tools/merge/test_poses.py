"""Poses that are told with `merge --pose`."""

import json
import math

import pytest

from merging.config import MergeConfig
from tbmslam.geometry.se2 import SE2
from tools import merge


def test_a_map_is_placed_at_its_known_pose(folders, tmp_path, capsys):
    turned = SE2(2.0, 3.0, math.radians(70.0)).inverse()
    words = [str(turned.x + 0.1), str(turned.y), "-67"]
    given = [str(folders / name) for name in ("here", "there", "foreign")]
    assert merge.main([*given, "-o", str(tmp_path), "--pose", "there", *words]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["pairs"][0]["method"] == "prior"
    assert report["maps"]["there"]["T_merged_map"] == pytest.approx(list(turned), abs=0.01)
    assert report["config"]["known_poses"] == {"there": [*map(float, words[:2]), math.radians(-67.0)]}
    assert "there in here: accepted: placed at the given pose, refined by 0." in capsys.readouterr().out


def test_a_pose_of_the_first_map_is_refused(folders, tmp_path, capsys):
    given = [str(folders / name) for name in ("here", "there")]
    assert merge.main([*given, "-o", str(tmp_path), "--set", "merging.known_poses.here=[0.0, 0.0, 0.0]"]) == 1
    told = "merge: --pose: poses are in the frame of here, the first map: give those of there"
    assert capsys.readouterr().err.strip() == told


def test_a_pose_that_is_no_number_is_wrong_usage(folders, tmp_path, capsys):
    given = [str(folders / name) for name in ("here", "there")]
    with pytest.raises(SystemExit, match="2"):
        merge.main([*given, "-o", str(tmp_path), "--pose", "there", "1", "two", "3"])
    assert "--pose must look like NAME X Y DEG, as robot_1 12.5 -3 90, got there 1 two 3" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "fact"),
    [
        (["there", "nan", "0", "0"], "--pose must be within 10000 m of the first map, at any angle, got there nan 0 0"),
        (
            ["there", "0", "-1e5", "0"],
            "--pose must be within 10000 m of the first map, at any angle, got there 0 -1e5 0",
        ),
        (["there", "0", "0", "inf"], "--pose must be within 10000 m of the first map, at any angle, got there 0 0 inf"),
        (
            ["there", "0", "0", "0", "--pose", "there", "9", "0", "0"],
            "--pose gives two poses of there, got there 9 0 0",
        ),
    ],
)
def test_poses_that_cannot_be_meant_are_wrong_usage(folders, tmp_path, capsys, words, fact):
    given = [str(folders / name) for name in ("here", "there")]
    with pytest.raises(SystemExit, match="2"):
        merge.main([*given, "-o", str(tmp_path), "--pose", *words])
    assert fact in capsys.readouterr().err


def test_no_pose_is_farther_than_the_parameters_allow():
    MergeConfig(known_poses={"there": (merge.FARTHEST_POSE, 0.0, 0.0)})
    with pytest.raises(ValueError, match="less than or equal to 10000"):
        MergeConfig(known_poses={"there": (1.001 * merge.FARTHEST_POSE, 0.0, 0.0)})
