from dataclasses import replace

import numpy as np
import pytest

from merging import MergeConfig, bridges, merger
from merging.alignment import Alignment, Alternative
from merging.bridges import refute_bridge
from merging.map_graph.grouping import groups_of
from merging.merge_state import MergeState
from merging.merger import merge
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor

CONFIG = MergeConfig.model_validate({"nonrigid": {"enabled": False}})
POSES = {"a": SE2(0.0, 0.0, 0.0), "b": SE2(5.0, 1.0, 1.0), "c": SE2(-3.0, 2.0, -2.0), "d": SE2(9.0, 9.0, 3.0)}
NOT_FITTING = "groups of 2 and 2 maps, which it alone joins, do not fit so (0.05): looks good"


def blank():
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 20, 20))
    grid.masses[5:15, 5:15] = (0.0, 1.0, 0.0, 0.0)
    return TbmMap(grid)


MAPS = {name: blank() for name in POSES}


def between(target, source):
    return POSES[target].inverse() @ POSES[source]


def found(pair, confidence, accepted=True, motion=None, alternatives=()):
    motion = motion or between(*pair)
    one = Alignment("correlation", accepted, "looks good", motion, agreed_wall_m=10.0, confidence=confidence)
    return {tuple(pair): replace(one, alternatives=alternatives)}


SURE = found("ab", 0.999) | found("cd", 0.999)


@pytest.fixture
def wholes(monkeypatch):
    """Groups are aligned as told; which maps were on which side is kept."""
    asked, answers = [], []

    def align_group_maps(wholes, pairs, *_):
        asked.append(tuple("".join(sorted(wholes[name].poses)) for name in pairs[0]))
        return {pairs[0]: answers[-1]}

    monkeypatch.setattr(bridges, "align_group_maps", align_group_maps)
    return asked, answers


def refuted(alignments, stood=()):
    found = MergeState.of(MAPS, alignments, lambda them: groups_of(list(POSES), them, CONFIG.graph))
    return refute_bridge(found, CONFIG, Executor(), stood)


def test_what_alone_joins_groups_that_do_not_fit_so_is_refused(wholes):
    asked, answers = wholes
    # What the groups say is said in the frames of their first maps.
    answers += found("ac", 0.05, accepted=False).values()
    (pair, refusal), fitting = refuted(SURE | found("bc", 0.95))
    assert asked == [("ab", "cd")]
    assert (pair, refusal.accepted, refusal.confidence, refusal.reason) == (("b", "c"), False, 0.05, NOT_FITTING)
    assert refusal.T_target_source == between("b", "c")
    assert fitting == set()


def test_it_stands_where_the_groups_offer_its_place_too(wholes):
    asked, answers = wholes
    alignments = SURE | found("bc", 0.95)
    elsewhere = SE2(30.0, 0.0, 0.0)
    there = Alternative(between("a", "c"), 0.2, 9.0)
    answers += found("ac", 0.7, accepted=False, motion=elsewhere, alternatives=(there,)).values()
    nothing, fitting = refuted(alignments)
    assert nothing is None
    assert fitting == {(("b", "c"), frozenset("ab"), frozenset("cd"))}
    assert refuted(alignments, stood=fitting) == (None, set())
    assert len(asked) == 1


def test_groups_too_large_to_be_one_map_do_not_speak_against_it(wholes, monkeypatch):
    monkeypatch.setattr(bridges, "group_maps_of", lambda *_: {"b": None})
    nothing, fitting = refuted(SURE | found("bc", 0.95))
    assert (nothing, len(fitting)) == (None, 1)
    assert wholes[0] == []


@pytest.mark.parametrize(
    "answer",
    [
        next(iter(found("ac", 0.9, motion=SE2(30.0, 0.0, 0.0)).values())),
        Alignment("correlation", accepted=False, reason="nothing in common"),
    ],
)
def test_groups_that_fit_elsewhere_or_nowhere_do_not_fit_so(wholes, answer):
    wholes[1].append(answer)
    (_, refusal), _ = refuted(SURE | found("bc", 0.95))
    assert refusal.confidence == 0.0


def test_maps_are_on_the_side_that_refused_alignments_put_them(wholes):
    asked, answers = wholes
    answers += found("ab", 0.05, accepted=False).values()
    # Without the one of a and b, the group would fall into a, c, d and b.
    refused = found("ad", 0.84, accepted=False) | found("cd", 0.8, accepted=False) | found("bd", 0.1, accepted=False)
    (pair, refusal), _ = refuted(found("ab", 0.95) | found("ac", 0.999) | refused)
    assert (pair, asked) == (("a", "b"), [("acd", "b")])
    assert refusal.reason.startswith("groups of 3 and 1 maps")


def told(pair, confidence):
    return {tuple(pair): replace(found(pair, confidence)[tuple(pair)], method="told")}


def test_a_map_laid_where_walls_do_not_bear_it_out_is_on_no_side(wholes):
    asked, answers = wholes
    answers += found("bc", 0.95).values()
    nothing, fitting = refuted(told("ab", 0.001) | found("bc", 0.95) | found("cd", 0.999))
    assert (nothing, asked) == (None, [("b", "cd")])
    assert fitting == {(("b", "c"), frozenset("b"), frozenset("cd"))}


def test_a_map_laid_where_walls_bear_it_out_is(wholes):
    asked, answers = wholes
    answers += found("ac", 0.05, accepted=False).values()
    (pair, _), _ = refuted(told("ab", 0.9) | found("bc", 0.95) | found("cd", 0.999))
    assert (pair, asked) == (("b", "c"), [("ab", "cd")])


def test_told_poses_join_both_sides_whatever_walls_say(wholes):
    assert refuted(told("ab", 0.001) | found("bc", 0.95) | told("ac", 0.001)) == (None, set())
    assert wholes[0] == []


def test_the_most_doubtful_comes_first(wholes):
    asked, answers = wholes
    answers += found("ac", 0.05, accepted=False).values()
    chain = found("ab", 0.97) | found("bc", 0.91) | found("cd", 0.95)
    (pair, _), _ = refuted(chain)
    assert pair == ("b", "c")
    assert asked == [("ab", "cd")]


@pytest.mark.parametrize(
    "alignments",
    [
        SURE | found("bc", 0.995),
        SURE | found("bc", 0.95) | found("ad", 0.95),
        found("ab", 0.9),
        SURE | {("b", "c"): replace(found("bc", 0.9)["b", "c"], method="told")},
    ],
    ids=["sure enough", "not alone", "two maps know no more", "somebody said so"],
)
def test_what_else_joins_maps_is_not_doubted(wholes, alignments):
    assert refuted(alignments) == (None, set())
    assert wholes[0] == []


def test_groups_that_were_joined_so_are_apart_in_the_merge(wholes, monkeypatch):
    wholes[1].extend(found("ac", 0.05, accepted=False).values())
    told = SURE | found("bc", 0.95)
    refused = Alignment("correlation", accepted=False, reason="")
    others = dict.fromkeys((("a", "c"), ("a", "d"), ("b", "d")), refused)
    monkeypatch.setattr(merger, "align_all", lambda *_: told | others)
    result = merge(MAPS, CONFIG)
    assert list(result.poses) == ["a", "b"]
    assert result.alignments["b", "c"].reason == NOT_FITTING
    assert NOT_FITTING in result.left_out["c"]
    np.testing.assert_allclose(result.poses["b"], POSES["b"], atol=1e-6)
