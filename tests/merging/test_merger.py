import html
import json
import math

import numpy as np
import pytest

from merging import MergeConfig, align, merge
from merging.alignment import Alignment
from merging.fusion import warp
from merging.map_graph.grouping import Group
from merging.merge_state import why_left_out
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap

CONFIG = MergeConfig(method="features")


def part(grid, first_col, last_col, T_robot_world=None, resolution=None):
    """What a robot with a frame of its own saw between two columns of a world, with its drive."""
    seen = TbmGrid(grid.geometry, grid.masses.copy())
    seen.masses[:, :first_col] = seen.masses[:, last_col:] = (0.0, 0.0, 0.0, 1.0)
    T_robot_world = T_robot_world or SE2.identity()
    lattice = seen.geometry._replace(resolution=resolution or seen.geometry.resolution)
    start = T_robot_world @ SE2(*grid.geometry.centre_of(100, (first_col + last_col) // 2), 0.5)
    drive = Drive("robot_0", Trajectory(np.zeros(1), np.array([start])), Keyframes.from_scans([], [], []))
    return TbmMap(warp(seen, T_robot_world, lattice), (drive,), {"recording": "world"})


def assert_near(found, true, metres=0.05, degrees=0.3):
    vx, vy, omega = (true.inverse() @ found).log()
    assert math.hypot(vx, vy) < metres
    assert abs(math.degrees(omega)) < degrees


TURNS = {"a": SE2(0.0, 0.0, 0.0), "b": SE2(-7.0, 30.0, math.radians(110.0)), "c": SE2(4.0, 4.0, math.radians(-65.0))}


def three_parts(world):
    columns = {"a": (0, 220), "b": (80, 320), "c": (40, 280)}
    return {name: part(world, *columns[name], TURNS[name]) for name in TURNS}


def test_a_turned_part_of_a_map_is_found(rooms):
    parts = three_parts(rooms(1))
    alignment = align(parts["a"], parts["b"], CONFIG)
    assert alignment.accepted, alignment.reason
    # The frame's origin is 30 m off, where a millimetre at the walls is a centimetre.
    assert_near(alignment.T_target_source, TURNS["a"] @ TURNS["b"].inverse(), metres=0.1)
    assert alignment.matches >= alignment.inliers >= CONFIG.consensus.min_inliers
    assert alignment.scale == pytest.approx(1.0, abs=0.02)
    assert alignment.rmse_m < 0.2
    assert alignment.agreement > 0.9
    assert alignment.conflict < 0.02


def test_a_real_map_is_found_in_its_turned_copy(real_map):
    true = SE2(12.0, -3.0, math.radians(-77.0))
    turned = warp(real_map, true, real_map.geometry)
    alignment = align(TbmMap(turned), TbmMap(real_map), CONFIG)
    assert alignment.accepted, alignment.reason
    assert_near(alignment.T_target_source, true)


def test_maps_of_other_cell_sizes_are_found(rooms):
    world = rooms(1)
    fine, coarse = part(world, 0, 320), part(world, 0, 320, TURNS["b"], resolution=0.1)
    alignment = align(fine, coarse, CONFIG)
    assert alignment.accepted, alignment.reason
    assert_near(alignment.T_target_source, TURNS["b"].inverse(), metres=0.1, degrees=0.6)


def test_a_map_of_a_wrong_resolution_is_refused_for_its_scale(rooms):
    grid = rooms(1)
    stretched = TbmGrid(grid.geometry._replace(resolution=0.06), grid.masses)
    alignment = align(TbmMap(grid), TbmMap(stretched), CONFIG.model_copy(update={"resolution": 0.05}))
    assert not alignment.accepted
    assert "at a scale of 0.8" in alignment.reason
    assert alignment.scale == pytest.approx(1 / 1.2, abs=0.02)


def test_an_empty_map_is_refused_by_name(rooms):
    empty = TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 10, 10)))
    for target, source, name in ((empty, TbmMap(rooms(1)), "target"), (TbmMap(rooms(1)), empty, "source")):
        alignment = align(target, source, CONFIG)
        assert not alignment.accepted
        assert alignment.T_target_source is None
        assert alignment.reason == f"the {name} map is empty: no cell of it is known"


@pytest.mark.parametrize("method", ["correlation", "features"])
@pytest.mark.parametrize(
    ("bare", "fact"),
    [
        ("target", "the target map holds no wall"),
        ("source", "the source map holds no wall"),
        ("both", "neither map holds a wall"),
    ],
)
def test_maps_without_a_wall_are_refused_by_name(rooms, method, bare, fact):
    lawn = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 100, 100))
    lawn.masses[:] = (0.0, 1.0, 0.0, 0.0)
    maps = {name: TbmMap(lawn if bare in (name, "both") else rooms(1)) for name in ("target", "source")}
    done = merge(maps, MergeConfig(method=method))
    found = done.alignments["target", "source"]
    assert (found.accepted, found.T_target_source) == (False, None)
    assert found.reason == f"{fact}: their relative pose is unknown"
    assert done.merged is None


def test_another_building_is_refused_with_the_numbers(rooms):
    alignment = align(TbmMap(rooms(1)), TbmMap(rooms(2)), CONFIG)
    assert not alignment.accepted
    assert "inliers among" in alignment.reason


def test_three_maps_become_one_and_the_foreign_one_is_named(rooms):
    world = rooms(1)
    maps = three_parts(world)
    maps = {"a": maps["a"], "foreign": TbmMap(rooms(2)), "b": maps["b"], "c": maps["c"]}
    result = merge(maps, CONFIG)
    assert list(result.poses) == ["a", "b", "c"]
    for name, pose in result.poses.items():
        assert_near(pose, TURNS["a"] @ TURNS[name].inverse(), metres=0.1)
    assert list(result.left_out) == ["foreign"]
    assert repr(result).startswith("Merge of 4 maps: merged a, b, c\n  foreign: no alignment with a merged map")
    assert result._repr_png_() == result.merged._repr_png_()
    shown = result._repr_html_()
    assert "<p>Merge of 4 maps: merged a, b, c</p><p>foreign: no alignment with a merged map" in shown
    assert shown.endswith(result.merged._repr_html_())
    assert "no alignment with a merged map was accepted; with " in result.left_out["foreign"]
    assert len(result.alignments) == 6

    merged = result.merged.grid
    back = warp(merged, TURNS["a"].inverse(), world.geometry)
    assert (back.geometry.rows, back.geometry.cols) == pytest.approx((240, 320), abs=3)
    row, col = round(-back.geometry.origin_y / 0.05), round(-back.geometry.origin_x / 0.05)
    common = back.masses[row : row + 240, col : col + 320, 1] > 0.5
    assert np.mean(world.masses[: common.shape[0], : common.shape[1], 1][common] > 0.5) > 0.99


def accepted_at(x, confidence):
    return Alignment("correlation", accepted=True, reason="all is well", T_target_source=SE2(x, 0.0, 0.0),
                     confidence=confidence, agreed_wall_m=10.0)  # fmt: skip


def test_every_robot_s_drive_moves_along(rooms):
    maps = three_parts(rooms(1))
    merged = merge(maps, CONFIG).merged
    assert [drive.name for drive in merged.drives] == ["a/robot_0", "b/robot_0", "c/robot_0"]
    for name, drive in zip(maps, merged.drives, strict=True):
        true = TURNS["a"] @ TURNS[name].inverse() @ maps[name].drives[0].trajectory.pose(0)
        assert_near(drive.trajectory.pose(0), true)
    assert set(merged.provenance["merged_from"]) == {"a", "b", "c"}
    json.dumps(merged.provenance)


def test_drives_of_one_name_are_named_after_their_maps_once(rooms):
    maps = three_parts(rooms(1))
    merged = merge({"1/robot_0": maps["a"], "robot_0": maps["b"], "c": maps["c"]}, CONFIG).merged
    assert [drive.name for drive in merged.drives] == ["1/robot_0", "robot_0", "c/robot_0"]


def test_a_merge_can_be_merged(rooms):
    maps = three_parts(rooms(1))
    two = merge({name: maps[name] for name in "ab"}, CONFIG).merged
    result = merge({"c": maps["c"], "ab": two}, CONFIG)
    assert_near(result.poses["ab"], TURNS["c"] @ TURNS["a"].inverse())
    assert [drive.name for drive in result.merged.drives] == ["robot_0", "a/robot_0", "b/robot_0"]


def test_nothing_in_common_merges_nothing(rooms):
    result = merge({"one": TbmMap(rooms(1)), "two": TbmMap(rooms(2))}, CONFIG)
    assert result.merged is None
    assert result.fusion is None
    assert dict(result.poses) == {}
    assert dict(result.left_out) == dict.fromkeys(["one", "two"], "no other map could be aligned with it")
    why = "no other map could be aligned with it"
    best = f"most confident pair, two in one: {result.alignments['one', 'two'].reason}"
    assert repr(result) == f"Merge of 2 maps: merged none\n  one: {why}\n  two: {why}\n  {best}"
    assert result._repr_png_() is None
    lines = ("Merge of 2 maps: merged none", f"one: {why}", f"two: {why}", html.escape(best))
    picture = result.alignments["one", "two"].picture_html("one", "two")
    assert result._repr_html_() == "".join(f"<p>{line}</p>" for line in lines) + picture


def test_maps_without_names_are_refused(rooms):
    maps = [TbmMap(rooms(1)), TbmMap(rooms(1))]
    with pytest.raises(TypeError, match=r"^maps must be a dict of maps by name, such as .*, got list$"):
        merge(maps, CONFIG)


def test_what_is_no_map_is_refused_by_its_name(rooms):
    maps = {"one": TbmMap(rooms(1)), "two": rooms(1)}
    with pytest.raises(TypeError, match=r"^maps must hold TbmMaps, got TbmGrid for two$"):
        merge(maps, CONFIG)


def test_contradicting_accepted_alignments_are_the_reason(rooms, monkeypatch):
    found = {
        ("a", "b"): accepted_at(0.0, 0.99),
        ("a", "c"): accepted_at(0.0, 0.98),
        ("b", "c"): accepted_at(20.0, 0.97),
        ("a", "d"): Alignment("correlation", accepted=False, reason="too little"),
    }
    monkeypatch.setattr("merging.rounds.align_all", lambda *_: found)
    as_they_are = MergeConfig.model_validate({"nonrigid": {"enabled": False}})
    result = merge(dict.fromkeys("abcd", TbmMap(rooms(1))), as_they_are)
    assert result.merged is None
    why = "its accepted alignments contradict each other"
    surest = {"a": "b", "b": "a", "c": "a"}
    expected = {name: f"{why}; the most confident, with {other}: all is well" for name, other in surest.items()}
    assert result.left_out == {**expected, "d": "no other map could be aligned with it"}


def test_rules_and_resolution_are_obeyed(rooms):
    maps = three_parts(rooms(1))
    chosen = {"coverage": "overlap", "rule": "conjunctive", "merged_resolution": 0.1}
    result = merge(maps, CONFIG.model_copy(update=chosen))
    assert result.merged.grid.geometry.resolution == 0.1
    lost = result.fusion.seen_by < 3
    assert lost.any()
    assert not result.merged.grid.is_known()[lost].any()


def test_the_same_maps_give_the_same_bytes(rooms):
    maps = three_parts(rooms(1))
    first, second = merge(maps, CONFIG).merged, merge(maps, CONFIG).merged
    assert first.grid.masses.tobytes() == second.grid.masses.tobytes()
    assert first.grid.geometry == second.grid.geometry


def test_one_map_is_too_few(rooms):
    with pytest.raises(ValueError, match="maps must be two or more, got 1"):
        merge({"only": TbmMap(rooms(1))}, CONFIG)


def test_the_reason_of_a_left_out_map_is_its_best_alignment_with_a_merged_map():
    """Its surest alignment is with a map that was left out, too: that says nothing."""
    refused = {"a": (3.0, "little agrees"), "b": (5.0, "more agrees"), "d": (50.0, "much agrees")}
    alignments = {
        ((name, "c") if name == "a" else ("c", name)): Alignment("correlation", False, why, agreed_wall_m=metres)
        for name, (metres, why) in refused.items()
    }
    group = Group({"a": SE2.identity(), "b": SE2(1.0, 0.0, 0.0)})
    assert why_left_out("c", group, alignments) == ("no alignment with a merged map was accepted; with b: more agrees")
