import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from merging import MergeConfig, merge
from merging.fusion import warp
from merging.report.json_report import as_json, draw_conflict, draw_overlay, write_report
from tbmslam.geometry.se2 import SE2
from tbmslam.io.atomic_file import FileNotWrittenError
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.map_layers import ROBOT_COLOURS
from tbmslam.report.page import RunInfo

CONFIG = MergeConfig(method="features")
DESCRIPTION = Path(__file__).resolve().parents[3] / "docs/report-json.md"
PAIR_KEYS = {
    "target", "source", "accepted", "reason", "T_target_source", "matches", "inliers", "rmse_m", "scale", "overlap_m2",
    "agreement", "conflict",
}  # fmt: skip


@pytest.fixture
def maps(rooms):
    moved = warp(rooms(1), SE2(1.0, 2.0, 0.5), rooms(1).geometry)
    return {"here": TbmMap(rooms(1)), "there": TbmMap(moved), "foreign": TbmMap(rooms(2))}


def test_the_report_has_every_pair_and_every_map(maps, tmp_path):
    result = merge(maps, CONFIG)
    write_report(tmp_path / "deep" / "merged", result, maps, CONFIG)
    report = json.loads((tmp_path / "deep" / "merged" / "report.json").read_text())
    assert report["merged"] is True
    assert report["frame"] == "here"
    assert [(pair["target"], pair["source"]) for pair in report["pairs"]] == [
        ("here", "there"),
        ("here", "foreign"),
        ("there", "foreign"),
    ]
    for pair in report["pairs"]:
        assert pair.keys() >= PAIR_KEYS
        assert pair["reason"]
    assert report["maps"]["there"]["T_merged_map"] == pytest.approx([*SE2(1.0, 2.0, 0.5).inverse()], abs=0.05)
    assert report["maps"]["foreign"] == {"merged": False, "T_merged_map": None, "reason": result.left_out["foreign"]}
    assert report["fusion"]["seen_by_several_m2"] == pytest.approx(192.0, rel=0.05)
    for picture in ("overlay.png", "contradictions.png"):
        assert cv2.imread(str(tmp_path / "deep" / "merged" / picture)) is not None


def test_a_deformed_map_is_drawn_deformed(maps, tmp_path):
    result = merge(maps, CONFIG)
    write_report(tmp_path / "as-merged", result, maps, CONFIG)
    bent = {**maps, "there": TbmMap(warp(maps["there"].grid, SE2(40.0, 0.0, 1.0), maps["there"].grid.geometry))}
    write_report(tmp_path / "bent", replace(result, deformed={"there": maps["there"]}), bent, CONFIG)
    for name in ("overlay.png", "contradictions.png"):
        assert (tmp_path / "bent" / name).read_bytes() == (tmp_path / "as-merged" / name).read_bytes()
    told, as_merged = (json.loads((tmp_path / name / "report.json").read_text()) for name in ("bent", "as-merged"))
    assert told["refinement"].pop("bent") == ["there"]
    assert as_merged["refinement"].pop("bent") == []
    assert told == as_merged
    page = (tmp_path / "bent" / "report.html").read_text()
    assert "there was deformed to fit" in page
    write_report(tmp_path / "both", replace(result, deformed=maps), maps, CONFIG)
    assert f"{' and '.join(maps)} were deformed to fit" in (tmp_path / "both" / "report.html").read_text()
    assert "there was deformed to fit" not in (tmp_path / "as-merged" / "report.html").read_text()


def test_a_map_of_reliability_zero_causes_no_conflict(maps, tmp_path):
    """Laid on another floor's map, it would deny the walls that fall into the next cells of each other."""
    told = {"known_poses": {"foreign": (0.0, 0.0, 0.0)}, "reliability": {"foreign": 0.0}}
    alone = {name: maps[name] for name in ("here", "there")}
    conflict_m2 = []
    for given, config in ((alone, CONFIG), (maps, CONFIG.model_copy(update=told))):
        write_report(tmp_path, merge(given, config), given, config)
        conflict_m2.append(json.loads((tmp_path / "report.json").read_text())["fusion"]["conflict_m2"])
    assert conflict_m2[1] == pytest.approx(conflict_m2[0])


def keys_in(value):
    """All names in a report, however deep."""
    if isinstance(value, dict):
        return value.keys() | set().union(*map(keys_in, value.values()))
    return set().union(*map(keys_in, value)) if isinstance(value, list | tuple) else set()


def test_every_key_is_described(maps):
    report = as_json(merge(maps, CONFIG), CONFIG)
    del report["config"]  # whose parameters --print-config describes
    report["maps"] = list(report["maps"].values())
    found = keys_in(report)
    assert {"evidence", "pieces", "alternatives", "conflict_m2"} <= found
    text = DESCRIPTION.read_text(encoding="utf-8")
    assert [key for key in sorted(found) if f"`{key}`" not in text] == []


def test_a_refusal_is_reported_without_pictures(maps, tmp_path):
    strangers = {name: maps[name] for name in ("here", "foreign")}
    result = merge(strangers, CONFIG)
    write_report(tmp_path, result, strangers, CONFIG)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["merged"] is False
    assert report["frame"] is None
    assert report["maps"]["here"]["T_merged_map"] is None
    assert {path.name for path in tmp_path.iterdir()} == {"report.html", "report.json"}


def test_walls_have_their_map_s_colour_and_common_ones_are_dark(rooms):
    grid = rooms(1)
    alone = TbmMap(type(grid)(grid.geometry, grid.masses.copy()))
    alone.grid.masses[:, :100] = (0.0, 0.0, 0.0, 1.0)
    maps = {"all": TbmMap(grid), "right": alone}
    result = merge(maps, CONFIG)
    picture = draw_overlay(result, maps, result.fusion)[::-1]
    np.testing.assert_array_equal(picture[0, 20], ROBOT_COLOURS[0])
    assert picture[0, 200].sum() < picture[0, 20].sum()
    assert tuple(picture[30, 30]) in {(255, 255, 255), ROBOT_COLOURS[0]}


def test_conflict_is_red(rooms):
    grid, changed = rooms(1), rooms(1)
    changed.masses[100:110, 150:160] = (0.0, 0.0, 1.0, 0.0)
    grid.masses[100:110, 150:160] = (0.0, 1.0, 0.0, 0.0)
    result = merge({"before": TbmMap(grid), "after": TbmMap(changed)}, CONFIG)
    picture = draw_conflict(result.fusion)[::-1]
    np.testing.assert_array_equal(picture[105, 155], (200, 0, 0))
    assert picture[20, 20, 0] == picture[20, 20, 1]
    assert result.fusion.conflict.sum() == pytest.approx(100.0)


def test_the_page_shows_the_run(maps, tmp_path):
    write_report(tmp_path, merge(maps, CONFIG), maps, CONFIG, RunInfo("merge here there", {"aligning": 12.345}))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "merge here there" in page
    assert "12.35" in page
    assert "features.ratio" in page
    assert "seen by several maps" in page


def test_the_same_merge_gives_the_same_bytes(maps, tmp_path):
    result = merge(maps, CONFIG)
    for folder in ("one", "two"):
        write_report(tmp_path / folder, result, maps, CONFIG)
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


def test_a_scale_that_is_no_number_does_not_spoil_the_report(maps):
    result = merge(maps, CONFIG)
    json.dumps(as_json(result, CONFIG), allow_nan=False)


def test_a_folder_that_cannot_be_written_is_named(maps, tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(FileNotWrittenError, match=r"report\.json: cannot be written"):
        write_report(tmp_path / "taken", merge(maps, CONFIG), maps, CONFIG)
