import itertools
from functools import partial

import pytest

from merging import MergeConfig, merge
from merging.map_graph.grouping import groups_of
from merging.merge_state import MergeState
from merging.rounds import with_pairs_aligned
from tbmslam.parallel.executor import Executor
from tests.merging.floors import maps_of_floors

FLOORS = (1, 2, 3)
EVERY_FLOOR = {(f"{floor} left", f"{floor} right") for floor in FLOORS}


@pytest.fixture(scope="module")
def maps():
    return maps_of_floors(FLOORS)


def in_rounds(*neighbours, **more):
    retrieval = {"few": 2, "neighbours": neighbours}
    return MergeConfig.model_validate({"nonrigid": {"enabled": False}, "retrieval": retrieval, **more})


def aligned(maps, config, known=()):
    grouping = partial(groups_of, list(maps), config=config.graph, known=dict(known))
    return with_pairs_aligned(MergeState.of(maps, {}, grouping), config, Executor())


@pytest.fixture(scope="module")
def first(maps):
    """What one round finds in which each map is aligned with the map most like it."""
    return aligned(maps, in_rounds(1))


def test_few_maps_are_aligned_in_all_pairs(maps):
    some = {name: maps[name] for name in ("1 left", "1 right", "2 left")}
    assert list(aligned(some, MergeConfig()).alignments) == list(itertools.combinations(some, 2))


def test_methods_other_than_the_correlation_align_all_pairs(maps):
    assert len(aligned(maps, in_rounds(1, method="features")).alignments) == 15


def test_each_of_many_maps_is_aligned_with_the_map_most_like_it(maps, first):
    assert all(any(name in pair for pair in first.alignments) for name in maps)
    assert len(first.alignments) <= len(maps)
    assert first.alignments.keys() >= {("1 left", "1 right"), ("2 left", "2 right")}


def test_the_three_maps_most_alike_are_enough_for_every_floor(maps):
    assert {pair for pair, found in aligned(maps, in_rounds(3)).alignments.items() if found.accepted} == EVERY_FLOOR


def test_further_rounds_align_what_may_join_groups_and_nothing_else(maps, first):
    more = aligned(maps, in_rounds(1, 5))
    joined = {name for group in first.groups if len(group) > 1 for name in group.poses}
    assert joined
    assert more.alignments.keys() > first.alignments.keys()
    for pair in more.alignments.keys() - first.alignments.keys():
        assert not first.are_joined(pair)
        assert joined & set(pair)  # two maps that fit nothing so far are strangers


def test_maps_of_known_poses_are_not_aligned_with_each_other(maps, first):
    right = first.group_of("1 left").poses
    known = {"1 left": right["1 left"], "1 right": right["1 right"]}
    some = {name: maps[name] for name in ("1 left", "1 right", "2 left", "3 left")}
    found = aligned(some, in_rounds(3), known).alignments
    assert set(found) == set(itertools.combinations(some, 2)) - {("1 left", "1 right")}


def test_merging_many_maps_says_which_maps_look_like_no_merged_one(maps):
    found = merge(maps, in_rounds(1))
    assert set(found.poses) == {"1 left", "1 right"}
    assert "no merged map is similar to it" in found.left_out["2 left"]
