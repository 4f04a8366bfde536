"""Bridges between maps of small floors. Two floors contain the same small room, so maps of both align there."""

from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.map_pairs import pairs as map_pairs
from merging import MergeConfig, align, merge, merged_group, merger
from merging.alignment import Alignment, PoseHypothesis
from merging.bridges import refutation
from merging.bridges.bridge import TOO_WEAK_TO_JOIN, bridges_of
from merging.bridges.refutation import verify_bridges, without_refuted_bridges
from merging.fusion import warp
from merging.map_graph.grouping import groups_of
from merging.merge_state import MergeState
from merging.pairwise import align_all
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Progress
from tests.merging.bent_floor import bent_maps
from tests.merging.conftest import draw_rooms, grid_of_occupancy
from tools.benchmarks.strangers import building_of
from tools.map_pairs.placed_maps import maps_by_name

# One worker draws the floors for all of them.
pytestmark = pytest.mark.xdist_group("refutation")

CONFIG = MergeConfig.model_validate({"nonrigid": {"enabled": False}})
POSES = {"a": SE2(0.0, 0.0, 0.0), "b": SE2(5.0, 1.0, 1.0), "c": SE2(-3.0, 2.0, -2.0), "d": SE2(9.0, 9.0, 3.0)}
"""T_map_floor of every map."""
ROOM = np.s_[95:135, 135:185]


def seen(floor, where, T_map_floor):
    """Return the map of the cells (rows, cols) of a floor that a robot saw, in the robot's frame."""
    grid = grid_of_occupancy(np.where(where, floor, np.int8(-1)), 0.05)
    return TbmMap(warp(grid, T_map_floor, grid.geometry))


def maps_of(first_floor, second_floor):
    """Return maps a and b of one floor, c and d of another; of the same place b and c see only the room."""
    shared = draw_rooms(10, 100, 120)[:40, :50]
    first, second = draw_rooms(first_floor), draw_rooms(second_floor)
    first[ROOM] = second[ROOM] = shared
    room, left, right = np.zeros((3, *first.shape), dtype=bool)
    room[ROOM] = left[ROOM] = right[ROOM] = left[:, :120] = right[:, 210:] = True
    views = {"a": (first, ~room), "b": (first, left), "c": (second, right), "d": (second, ~room)}
    return {name: seen(floor, where, POSES[name]) for name, (floor, where) in views.items()}


@pytest.fixture(scope="module")
def strangers():
    """Two maps of each of two buildings."""
    return maps_of(1, 2)


@pytest.fixture(scope="module")
def neighbours():
    """Four maps of one building."""
    return maps_of(1, 1)


def alignment_at(pair, confidence, motion=None, method="correlation", *, accepted=True):
    """Return an alignment of a pair, at the truth where no motion is given."""
    motion = motion or POSES[pair[0]] @ POSES[pair[1]].inverse()
    return {tuple(pair): Alignment(method, accepted, "it fits", motion, agreed_wall_m=10.0, confidence=confidence)}


SURE = alignment_at("ab", 0.999, method="features") | alignment_at("cd", 0.999, method="features")
"""Alignments of maps of one floor. Bridges are aligned by correlation."""


def state_of(maps, alignments):
    return MergeState.of(maps, alignments, lambda known: groups_of(list(POSES), known, CONFIG.graph))


def refuted(maps, alignments, confirmed=(), config=CONFIG):
    return verify_bridges(state_of(maps, alignments), config, Progress(), confirmed)


def sides_of(alignments):
    """Return the pair of every bridge, and the maps on either side of it."""
    (group,) = (group for group in state_of({}, alignments).groups if "a" in group.poses)
    found = bridges_of(group, alignments, CONFIG)
    return {"".join(bridge.pair): tuple("".join(sorted(side)) for side in bridge.sides) for bridge in found}


def switch_off(monkeypatch):
    """Verify no bridges in a merge."""
    monkeypatch.setattr(merger, "without_refuted_bridges", lambda found, *_: found)


def test_two_buildings_that_share_a_room_are_one_only_without_the_check(strangers, monkeypatch):
    with monkeypatch.context() as ablated:
        switch_off(ablated)
        joined = merge(strangers, CONFIG)
    assert joined.alignments["b", "c"].accepted
    assert list(joined.poses) == ["a", "b", "c", "d"]
    parted = merge(strangers, CONFIG)
    assert list(parted.poses) == ["a", "b"]
    assert not parted.alignments["b", "c"].accepted
    assert parted.left_out.keys() == {"c", "d"}


def test_a_refuted_bridge_keeps_its_pose_and_has_a_reason(strangers):
    aligned = align_all(strangers, CONFIG)
    before = aligned["b", "c"]
    assert before.confidence > 0.9
    found, fitting = refuted(strangers, aligned)
    refusal = found["b", "c"]
    assert (refusal.accepted, refusal.T_target_source) == (False, before.T_target_source)
    assert refusal.confidence <= TOO_WEAK_TO_JOIN
    assert refusal.reason.startswith("the groups of 2 and 2 maps that it joins")
    assert refusal.reason.endswith(before.reason)
    assert fitting == set()


def test_a_true_bridge_is_kept_and_its_groups_are_not_aligned_again(neighbours):
    alignments = SURE | alignment_at("bc", 0.95)
    nothing, fitting = refuted(neighbours, alignments)
    assert nothing == {}
    assert fitting == {frozenset({frozenset("ab"), frozenset("cd")})}
    assert refuted({}, alignments, confirmed=fitting) == ({}, set())


def test_groups_that_fit_elsewhere_do_not_confirm_a_bridge(neighbours):
    motion = POSES["b"] @ SE2(3.0, 0.0, 0.0) @ POSES["c"].inverse()
    found, _ = refuted(neighbours, SURE | alignment_at("bc", 0.95, motion))
    assert (found["b", "c"].accepted, found["b", "c"].confidence) == (False, 0.0)


def test_groups_without_a_wall_in_common_do_not_confirm_a_bridge(neighbours):
    lawn = seen(np.zeros((100, 100), dtype=np.int8), np.True_, SE2.identity())
    found, _ = refuted(neighbours | {"c": lawn, "d": lawn}, SURE | alignment_at("bc", 0.95))
    assert (found["b", "c"].accepted, found["b", "c"].confidence) == (False, 0.0)


def test_a_true_alignment_of_a_deformed_map_is_confirmed_by_the_deformed_sides():
    whole, bent, _ = bent_maps("store")
    min_x, min_y, max_x, max_y = whole.grid.geometry.bounds()
    part = whole.crop(min_x, min_y, min_x + 0.7 * (max_x - min_x), max_y)
    found = align(part, bent)
    assert found.accepted
    assert found.bent_m > 0.0
    alignments = alignment_at("ab", 0.999, SE2.identity(), "features") | {("b", "c"): found}
    nothing, fitting = refuted({"a": whole, "b": part, "c": bent}, alignments, config=MergeConfig())
    assert nothing == {}
    assert fitting == {frozenset({frozenset("ab"), frozenset("c")})}


@pytest.mark.slow
@pytest.mark.parametrize(("verified", "buildings"), [(True, {1}), (False, {1, 4})])
def test_two_buildings_that_a_deformed_map_fits_are_one_only_without_the_check(monkeypatch, verified, buildings):
    rng = np.random.default_rng([2812, 30, 10])
    fleet = [list(map_pairs.maps_of(building_of(281_200_000 + index, rng), 10, rng)) for index in range(5)]
    placed = {f"{index}-{number}": fleet[index][number] for index, number in ((1, 4), (1, 0), (4, 8), (4, 0))}
    if not verified:
        switch_off(monkeypatch)
    # The usual limit refuses the deformed map itself.
    lenient = MergeConfig.model_validate({"verification": {"min_confidence": 0.7}})
    found = merge(maps_by_name(placed), lenient)
    assert {int(name[0]) for name in found.poses} == buildings


@pytest.mark.parametrize("tile", [0, 1])
def test_a_bridge_of_groups_that_fit_elsewhere_as_well_is_refuted(tile):
    """A corridor of two equal halves: a map of one half fits both."""
    half = draw_rooms(3, 160, 160)
    both = np.hstack((half, half))
    everywhere, lower = np.ones_like(both, dtype=bool), np.zeros_like(both, dtype=bool)
    lower[:80] = True
    none = SE2.identity()
    maps = {"a": seen(both, everywhere, none), "b": seen(both, lower, none), "c": seen(half, half > -1, none)}
    motion = SE2(tile * 160 * 0.05, 0.0, 0.0)
    found, _ = refuted(maps, alignment_at("ab", 0.999, none, "features") | alignment_at("bc", 0.95, motion))
    assert not found["b", "c"].accepted
    confidence = float(found["b", "c"].reason.split("confidence ")[1].split()[0])
    assert confidence == pytest.approx(0.45, abs=0.07)


def test_groups_too_large_to_be_one_map_do_not_refute_a_bridge(strangers, monkeypatch, caplog):
    monkeypatch.setattr(merged_group, "MAX_CELLS", 1000)
    nothing, fitting = refuted(strangers, SURE | alignment_at("bc", 0.95))
    assert (nothing, len(fitting)) == ({}, 1)
    assert "cells, more than the 1e+03 that are possible" in caplog.messages[-1]


@pytest.mark.parametrize(
    ("step", "where"),
    [("align_deformable", "bridge between b and c is"), ("jointly_refined", "bridges between a, b, c, d are")],
)
def test_a_bridge_is_not_refuted_if_memory_runs_out(strangers, monkeypatch, caplog, step, where):
    def none_left(*_):
        raise MemoryError

    monkeypatch.setattr(refutation, step, none_left)
    nothing, fitting = refuted(strangers, SURE | alignment_at("bc", 0.95))
    assert (nothing, len(fitting)) == ({}, 1)
    assert caplog.messages == [f"the {where} not verified: memory has run out"]


@pytest.mark.parametrize(("least", "accepted"), [(0.85, False), (0.75, True)])
def test_a_bridge_must_be_as_confident_as_an_accepted_pair(strangers, monkeypatch, least, accepted):
    monkeypatch.setattr(refutation, "_confidence_of", lambda *_: 0.8)
    alignments = SURE | alignment_at("bc", 0.95)
    (group,) = state_of(strangers, alignments).groups
    config = MergeConfig.model_validate({"verification": {"min_confidence": least}})
    state = MergeState.of(strangers, alignments, lambda _: [group])
    found = without_refuted_bridges(state, config, Progress()).alignments["b", "c"]
    assert (found.accepted, found.confidence) == ((True, 0.95) if accepted else (False, TOO_WEAK_TO_JOIN))
    assert accepted or "(confidence 0.800 is under 0.85)" in found.reason


def test_the_most_doubtful_bridge_is_verified_first(strangers):
    chain = alignment_at("ab", 0.97) | alignment_at("bc", 0.91) | alignment_at("cd", 0.95)
    found, fitting = refuted(strangers, chain)
    assert (list(found), fitting) == ([("b", "c")], set())


def test_groups_are_verified_after_one_joint_optimisation(neighbours, monkeypatch):
    asked = []
    monkeypatch.setattr(refutation, "jointly_refined", lambda *args: asked.append(set(args[1])))
    refuted(neighbours, alignment_at("ab", 0.91) | alignment_at("bc", 0.99) | alignment_at("cd", 0.92))
    assert asked == [set("abcd")]


AGREEING = [alignment_at(pair, p, accepted=False) for pair, p in (("bc", 0.84), ("ad", 0.8), ("bd", 0.7), ("ac", 0.6))]


def test_refused_alignments_that_agree_are_a_bridge_as_well(strangers, neighbours):
    alignments = SURE | AGREEING[0] | AGREEING[1] | AGREEING[2] | AGREEING[3]
    assert [len(group) for group in state_of(strangers, alignments).groups] == [4]
    assert sides_of(alignments) == {"bc": ("ab", "cd")}
    found, _ = refuted(strangers, alignments)
    assert found.keys() == alignments.keys() - SURE.keys()
    assert all(one.confidence <= TOO_WEAK_TO_JOIN for one in found.values())
    assert [len(group) for group in state_of(strangers, alignments | found).groups] == [2, 2]
    assert refuted(neighbours, alignments)[0] == {}


def test_a_refuted_bridge_of_a_group_that_stays_is_not_checked_again(strangers):
    alignments = SURE | AGREEING[0] | AGREEING[1]
    (group,) = state_of(strangers, alignments).groups
    found = without_refuted_bridges(MergeState.of(strangers, alignments, lambda _: [group]), CONFIG, Progress())
    assert found.alignments["b", "c"].confidence <= TOO_WEAK_TO_JOIN


def test_refuted_alternatives_are_unlikely_too(strangers):
    elsewhere = SE2(30.0, 0.0, 0.0)
    (_, second), *_ = AGREEING[1].items()
    alternative = PoseHypothesis(second.T_target_source, 0.8, 10.0)
    other = {("a", "d"): replace(second, T_target_source=elsewhere, confidence=0.1, alternatives=(alternative,))}
    found, _ = refuted(strangers, SURE | AGREEING[0] | AGREEING[2] | AGREEING[3] | other)
    assert (found["a", "d"].confidence, found["a", "d"].T_target_source) == (0.1, elsewhere)
    assert found["a", "d"].alternatives[0].confidence <= TOO_WEAK_TO_JOIN


def test_every_alignment_of_a_chain_is_a_bridge_however_confident():
    chain = alignment_at("ab", 0.9999) | alignment_at("bc", 0.9999) | alignment_at("cd", 0.9999)
    assert sides_of(chain) == {"ab": ("a", "bcd"), "bc": ("ab", "cd"), "cd": ("abc", "d")}


def test_two_alignments_that_join_groups_of_several_maps_are_a_bridge(strangers, neighbours):
    alignments = SURE | alignment_at("bc", 0.95) | alignment_at("ad", 0.97)
    assert sides_of(alignments) == {"ad": ("ab", "cd")}
    found, _ = refuted(strangers, alignments)
    assert [found[pair].accepted for pair in (("b", "c"), ("a", "d"))] == [False, False]
    assert found["b", "c"].reason.startswith("the groups of 2 and 2 maps that it joins")
    assert refuted(neighbours, alignments)[0] == {}


def test_an_outvoted_alignment_of_the_sides_is_not_refused_with_the_bridge(strangers):
    elsewhere = alignment_at("ad", 0.95, POSES["a"] @ SE2(9.0, 0.0, 1.0) @ POSES["d"].inverse())
    alignments = SURE | alignment_at("bc", 0.99999) | elsewhere
    (group,) = state_of(strangers, alignments).groups
    assert group.outvoted == (("a", "d"),)
    found, _ = refuted(strangers, alignments)
    assert found.keys() == {("b", "c")}


def test_bridges_of_other_pairs_are_not_verified_again(strangers):
    state = state_of(strangers, SURE | alignment_at("bc", 0.95))
    assert verify_bridges(state, CONFIG, Progress(), among=[("a", "d")]) == ({}, set())


def test_refused_alignments_put_maps_on_sides():
    # Without the alignment of a and b, the group falls into a, c, d and b; no accepted one joins d.
    refused = [alignment_at(pair, p, accepted=False) for pair, p in (("ad", 0.84), ("cd", 0.8), ("bd", 0.1))]
    alignments = (
        alignment_at("ab", 0.95) | alignment_at("ac", 0.999, method="features") | refused[0] | refused[1] | refused[2]
    )
    assert sides_of(alignments) == {"ab": ("acd", "b"), "ad": ("abc", "d")}


@pytest.mark.parametrize(("confidence", "side"), [(0.001, "b"), (0.9, "ab")])
def test_a_map_with_a_known_pose_is_on_a_side_only_if_walls_agree_there(confidence, side):
    alignments = (
        alignment_at("ab", confidence, method="prior")
        | alignment_at("bc", 0.95)
        | alignment_at("cd", 0.999, method="features")
    )
    assert sides_of(alignments) == {"bc": (side, "cd")}


@pytest.mark.parametrize(
    "alignments",
    [
        SURE | alignment_at("bc", 0.95) | alignment_at("ad", 0.95) | alignment_at("ac", 0.95),
        alignment_at("ab", 0.95) | alignment_at("bc", 0.95) | alignment_at("ac", 0.95),
        alignment_at("ab", 0.9),
        SURE | alignment_at("bc", 0.9, method="prior"),
        alignment_at("ab", 0.001, method="prior")
        | alignment_at("bc", 0.95)
        | alignment_at("ac", 0.001, method="prior"),
    ],
    ids=["three alignments", "three maps", "two maps only", "known pose", "two known poses"],
)
def test_other_alignments_are_no_bridges(alignments):
    assert sides_of(alignments) == {}
