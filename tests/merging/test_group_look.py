import math
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.map_distortion import Distortion
from datasets.synthetic.map_pairs import building_of_world
from merging import MergeConfig, merge, whole_groups
from merging.alignment import Alignment
from merging.exactness import known_best_at
from merging.findings import Findings
from merging.group_look import look_at_groups
from merging.map_graph import Group
from merging.merged_group import merge_group
from merging.workforce import Workforce
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap
from tools.pair_files import grid_of

CONFIG = MergeConfig.model_validate({"bent": {"enabled": False}})
AS_MAPS = MergeConfig.model_validate({"bent": {"enabled": False}, "graph": {"as_wholes": False}})
T_A_MERGED, T_MERGED_FIRST = SE2(2.0, -1.0, 0.5), SE2(-4.0, 3.0, -2.0)
COVARIANCE = tuple(map(tuple, np.diag([1e-4, 1e-4, 1e-6])))


@pytest.fixture(scope="module")
def between():
    """Two robots of which neither sees more than 1.1 m of what the third saw, who was between theirs."""
    building = building_of_world("office", 1)
    cols = np.flatnonzero((building.occupancy >= 0).any(axis=0))
    col, middle = np.arange(building.occupancy.shape[1]), cols[0] + (cols[-1] - cols[0]) // 2
    near = col >= middle - 280
    seen = {
        "left": near & (col < middle),
        "right": near & ((col < middle - 22) | (col >= middle)),
        "strip": abs(col - middle) < 22,
    }
    rng, maps, truth = np.random.default_rng(1), {}, {}
    for name, those in seen.items():
        part = np.where(those, building.occupancy, -1).astype(np.int8)
        spoilt = Distortion.draw(rng).spoil(part, building.resolution, rng)
        maps[name] = TbmMap(grid_of(spoilt.occupancy, building.resolution))
        truth[name] = spoilt.T_map_building
    return maps, truth


def test_a_map_between_two_is_found_by_what_both_say(between):
    maps, truth = between
    assert list(merge(maps, AS_MAPS).poses) == ["left", "right"]
    found = merge(maps, CONFIG)
    assert list(found.poses) == list(maps)
    assert found.alignments["right", "strip"].reason.startswith("one map onto 2 maps merged so far: confidence 0.9")
    true = truth["left"] @ truth["strip"].inverse()
    assert math.dist(found.poses["strip"].apply((5.0, 5.0)), true.apply((5.0, 5.0))) < 0.15
    assert found.poses["strip"].theta == pytest.approx(true.theta, abs=0.02)
    target, source = found.judged_by["right", "strip"]
    assert target.is_known().sum() > maps["right"].grid.is_known().sum()
    assert source is maps["strip"].grid


def test_who_is_named_first_does_not_matter(between):
    maps, _ = between
    lying = []
    for names in (("left", "right", "strip"), ("right", "left", "strip"), ("strip", "left", "right")):
        poses = merge({name: maps[name] for name in names}, CONFIG).poses
        lying.append([poses["left"].inverse() @ poses[name] for name in ("right", "strip")])
    np.testing.assert_allclose(lying[1:], [lying[0]] * 2, atol=1e-6)


def blank():
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 20, 20))
    grid.masses[5:15, 5:15] = (0.0, 1.0, 0.0, 0.0)
    return TbmMap(grid)


MAPS = {name: blank() for name in "abcd"}
GROUPS = [
    Group({"b": SE2.identity(), "d": SE2(1.0, 0.0, 0.0)}),
    Group({"a": SE2.identity()}),
    Group({"c": SE2.identity()}),
]


@pytest.fixture
def told(monkeypatch):
    """Groups are merged in frames of their own and aligned as told; the pairs that were asked for are kept."""
    asked, answers = [], {}

    def merged(*args):
        whole = merge_group(*args)
        return replace(whole, poses={name: T_MERGED_FIRST @ pose for name, pose in whole.poses.items()})

    def align_all(_maps, _config, _workforce, pairs):
        asked.append(pairs)
        return {pair: answers.get(pair, Alignment("correlation", accepted=False, reason="")) for pair in pairs}

    monkeypatch.setattr(whole_groups, "merge_group", merged)
    monkeypatch.setattr(whole_groups, "align_all", align_all)
    return asked, answers


def looked(groups, alignments, config, tried=()):
    return look_at_groups(Findings.of(MAPS, alignments, lambda _: groups), config, Workforce(), tried)


def accepted(confidence, motion=T_A_MERGED):
    return Alignment(
        "correlation", True, "good", motion, agreed_wall_m=9.0, confidence=confidence, covariance=COVARIANCE
    )


def test_what_is_found_of_a_group_is_told_of_the_map_that_knows_most(told):
    _, answers = told
    answers["a", "b"] = accepted(0.9)
    look, tried = looked(GROUPS, {}, CONFIG)
    assert look.pair == ("a", "b")
    assert look.alignment.reason == "2 maps onto one map merged so far: good"
    assert look.alignment.T_target_source == pytest.approx(T_A_MERGED @ T_MERGED_FIRST)
    assert known_best_at(look.alignment.covariance) == pytest.approx(T_MERGED_FIRST.inverse().apply((0.0, 0.0)))
    assert look.grids[0] is MAPS["a"].grid
    # The merged cells, which the fixture says lie elsewhere, are where the first map has them.
    middles = [np.argwhere(grid.is_known()).mean(axis=0) for grid in (MAPS["b"].grid, look.grids[1])]
    merged_middle = look.grids[1].geometry.centre_of(*middles[1])
    here = MAPS["b"].grid.geometry.centre_of(*middles[0])
    assert T_MERGED_FIRST.apply(merged_middle) == pytest.approx((here[0] + 0.5, here[1]), abs=0.1)
    assert tried == {members("a", "bd"), members("bd", "c")}


def members(*groups):
    return frozenset(map(frozenset, groups))


def test_the_surest_comes_first_and_others_that_were_accepted_get_their_turn(told):
    asked, answers = told
    answers |= {("a", "b"): accepted(0.9), ("b", "c"): accepted(0.95)}
    look, tried = looked(GROUPS, {}, CONFIG)
    assert (look.pair, tried) == (("b", "c"), {members("bd", "c")})
    again, tried = looked(GROUPS, {}, CONFIG, tried)
    assert (again.pair, tried) == (("a", "b"), {members("a", "bd")})
    assert asked == [[("a", "b"), ("b", "c")], [("a", "b")]]


def test_nothing_new_is_no_reason_to_look(told):
    asked, _ = told
    alone = [Group({name: SE2.identity()}) for name in "abc"]
    assert looked(alone, {}, CONFIG) == (None, set())
    assert looked(GROUPS, {}, AS_MAPS) == (None, set())
    contradicted = {("a", "d"): accepted(0.9), ("c", "d"): accepted(0.99)}
    assert looked(GROUPS, contradicted, CONFIG) == (None, set())
    assert asked == []
    nothing, tried = looked(GROUPS, {}, CONFIG)
    assert (nothing, tried) == (None, {members("a", "bd"), members("bd", "c")})
    assert looked(GROUPS, {}, CONFIG, tried) == (None, set())


def test_a_group_too_large_to_be_one_map_ends_nothing(told):
    asked, _ = told
    groups = [Group({"b": SE2.identity(), "d": SE2(9000.0, 9000.0, 0.0)}), Group({"a": SE2.identity()})]
    groups.append(Group({"c": SE2.identity()}))
    assert looked(groups, {}, CONFIG) == (None, {members("a", "bd"), members("bd", "c")})
    assert asked == [[]]
