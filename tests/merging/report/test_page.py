import re
from dataclasses import replace

import numpy as np
import pytest

from merging import MergeConfig, merge
from merging.alignment import Alignment, PoseHypothesis
from merging.fusion import warp
from merging.merger import Merge
from merging.report.page import confidences_of, merge_page
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.map_layers import ROBOT_COLOURS
from tbmslam.report.page import RunInfo

CONFIG = MergeConfig(method="features")
PROVENANCE = {
    "warnings": ["3 scans are stamped earlier than the scan before"],
    "incidents": [{"stamp": 0.9, "what": "the stamps of the scans step back"}],
}
T_HERE_THERE = SE2(1.0, 2.0, 0.5).inverse()


@pytest.fixture
def maps(rooms):
    moved = warp(rooms(1), T_HERE_THERE.inverse(), rooms(1).geometry)
    way = Trajectory(np.array([0.0, 1.0]), np.array([[2.0, 3.0, 0.0], [3.0, 3.0, 0.0]]))
    drive = Drive("robot", way, Keyframes.from_scans([], [], []))
    return {
        "here": TbmMap(rooms(1), (drive,), PROVENANCE),
        "there": TbmMap(moved, (drive,)),
        "foreign": TbmMap(rooms(2)),
    }


def test_the_page_of_a_merge_has_all_layers_poses_and_warnings(maps):
    result = merge(maps, CONFIG)
    page = merge_page(result, maps, CONFIG, {"known": 12.3}, RunInfo("merge a b", {"aligning": 2.0}))
    assert page.verdict == "2 of 3 maps were merged."
    assert not page.good
    assert [sheet.title for sheet in page.sheets] == ["Merged map", "foreign"]
    switches = [(layer.switch.group, layer.switch.label, layer.switch.column) for layer in page.sheets[0].layers]
    assert switches == [
        *(("Map", name, "") for name in ("pignistic", "occupied", "free", "unknown", "conflict")),
        *(("Robots", name, "map") for name in ("here", "there")),
        *(("Robots", name, column) for name in ("here", "there") for column in ("drive", "key\u00adframes", "loops")),
        ("Robots", "here", "inci\u00addents"),
        *(("Evidence", name, "") for name in ("overlap", "contradictions")),
    ]
    (incidents,) = (layer for layer in page.sheets[0].layers if layer.switch.column == "inci\u00addents")
    np.testing.assert_allclose(incidents.points, [result.poses["here"].apply([3.0, 3.0])], atol=1e-6)
    assert incidents.texts == ["1.0 s: the stamps of the scans step back"]
    table = page.tables[0]
    assert table.colours == [f"rgb{colour}" for colour in ROBOT_COLOURS[:2]]
    assert [float(cell) for cell in table.rows[1][1:3]] == pytest.approx(T_HERE_THERE[:2], abs=0.05)
    assert table.rows[2][1:4] == ("–", "–", "–")
    said = " ".join(page.warnings)
    assert "foreign was left out: " in said
    assert "here: 3 scans are stamped earlier" in said
    assert "without joint optimisation" in said
    assert (page.command, page.seconds) == ("merge a b", {"aligning": 2.0})
    assert page.to_html().count("<article") == 3


def test_robots_are_drawn_in_their_colours_where_they_stand(maps):
    layers = merge_page(merge(maps, CONFIG), maps, CONFIG, {}, RunInfo()).sheets[0].layers
    walls = {layer.switch.label: layer for layer in layers if layer.switch.column == "map"}
    assert walls["there"].palette.colours[2] == ROBOT_COLOURS[1]
    here, there = (np.count_nonzero(walls[name].levels == 2) for name in ("here", "there"))
    assert there == pytest.approx(here, rel=0.1)
    drives = {layer.switch.label: layer.points for layer in layers if layer.switch.column == "drive"}
    np.testing.assert_allclose(drives["there"][0], T_HERE_THERE.apply(drives["here"][0]), atol=0.05)


def test_nothing_merged_shows_the_maps_apart(maps):
    strangers = {name: maps[name] for name in ("here", "foreign")}
    page = merge_page(merge(strangers, CONFIG), strangers, CONFIG, {}, RunInfo())
    assert page.verdict == "No two maps could be merged."
    assert [sheet.title for sheet in page.sheets] == ["here", "foreign"]
    written = page.to_html().lower().partition("how it was made")[0].partition("<body>")[2]
    assert "nan" not in re.sub(r"[a-z0-9+/]{100,}", "", written)  # pictures may spell anything


def test_a_pose_is_as_sure_as_the_weakest_link_of_the_strongest_way():
    sure = {("a", "b"): 0.99, ("b", "c"): 0.8, ("a", "c"): 0.3, ("c", "d"): 0.95}
    alignments = {
        pair: Alignment("correlation", accepted=True, reason="r", T_target_source=SE2.identity(), confidence=confidence)
        for pair, confidence in sure.items()
    }
    result = Merge(None, dict.fromkeys("abcd", SE2.identity()), alignments, {}, None, None, tuple(sure))
    assert confidences_of(result, CONFIG) == {"a": 1.0, "b": 0.99, "c": 0.8, "d": 0.8}
    assert confidences_of(replace(result, poses={}, used=()), CONFIG) == {}


def test_a_pose_is_as_sure_as_the_alternative_that_agrees_with_it():
    elsewhere, here = SE2(9.0, 0.0, 0.0), PoseHypothesis(SE2(0.3, 0.0, 0.0), 0.2, 5.0)
    found = Alignment(
        "correlation", accepted=False, reason="r", T_target_source=elsewhere, confidence=0.7, alternatives=(here,)
    )
    result = Merge(None, dict.fromkeys("ab", SE2.identity()), {("a", "b"): found}, {}, None, None, (("a", "b"),))
    assert confidences_of(result, CONFIG) == {"a": 1.0, "b": 0.2}
    bent_away = replace(result, poses={"a": SE2.identity(), "b": SE2(4.0, 0.0, 0.0)})
    assert confidences_of(bent_away, CONFIG) == {"a": 1.0, "b": 0.7}


def test_ambiguous_and_outvoted_pairs_and_unsure_poses_are_warned_of(maps):
    result = merge(maps, CONFIG)
    pair = ("here", "there")
    shaky = replace(result.alignments[pair], confidence=0.75)
    doubtful = replace(result.alignments["here", "foreign"], ambiguous=True)
    changed = replace(
        result,
        alignments={**result.alignments, pair: shaky, ("here", "foreign"): doubtful},
        outvoted=(("there", "foreign"),),
    )
    said = merge_page(changed, maps, CONFIG, {}, RunInfo()).warnings
    assert "foreign in here is ambiguous: the maps fit in 1 places" in said
    assert "the pose of there is not sure: confidence 0.750" in said
    assert any(text.startswith("foreign in there was accepted by itself, but contradicts") for text in said)


def test_a_map_left_out_shows_where_it_had_trouble(maps):
    maps["foreign"] = replace(maps["foreign"], drives=maps["here"].drives, provenance=PROVENANCE)
    page = merge_page(merge(maps, CONFIG), maps, CONFIG, {}, RunInfo())
    (incidents,) = (layer for layer in page.sheets[1].layers if layer.switch.column == "inci\u00addents")
    assert incidents.texts == ["1.0 s: the stamps of the scans step back"]


def test_equal_warnings_of_several_robots_are_joined(maps):
    maps["there"] = replace(maps["there"], provenance={"warnings": [*PROVENANCE["warnings"], "at 3.0 s: lost"]})
    maps["foreign"] = replace(maps["foreign"], provenance={"warnings": ["at 4.0 s: lost"]})
    said = merge_page(merge(maps, CONFIG), maps, CONFIG, {}, RunInfo()).warnings
    assert said[-3:] == [
        "here, there: 3 scans are stamped earlier than the scan before",
        "there: at 3.0 s: lost",
        "foreign: at 4.0 s: lost",
    ]


def test_warnings_of_the_parts_of_a_merged_map_are_shown(maps):
    first = merge({name: maps[name] for name in ("here", "there")}, CONFIG).merged
    assert first is not None
    again = {"both": first, "foreign": maps["foreign"]}
    page = merge_page(merge(again, CONFIG), again, CONFIG, {}, RunInfo())
    assert "both: here: 3 scans are stamped earlier than the scan before" in page.warnings
    (incidents,) = (layer for layer in page.sheets[0].layers if layer.switch.column == "inci\u00addents")
    assert incidents.texts == ["1.0 s: the stamps of the scans step back"]
    odd = replace(first, provenance={"merged_from": {"here": 3, "there": {"provenance": []}}, "warnings": 1})
    again = {"both": odd, "foreign": maps["foreign"]}
    assert not [
        said for said in merge_page(merge(again, CONFIG), again, CONFIG, {}, RunInfo()).warnings if "both:" in said
    ]
