import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from merging.alignment import Alignment, PoseHypothesis, seen_from
from merging.config.groups import GraphConfig
from merging.map_graph.grouping import _without_outvoted, groups_of
from merging.map_graph.links import edges_of
from tbmslam.geometry.se2 import SE2

POSES = {"a": SE2(0.0, 0.0, 0.0), "b": SE2(5.0, 1.0, 1.0), "c": SE2(-3.0, 2.0, -2.0), "d": SE2(9.0, 9.0, 3.0)}


def found(target, source, confidence=0.95, accepted=True, T=None, others=()):
    motion = T or POSES[target].inverse() @ POSES[source]
    alternatives = tuple(PoseHypothesis(other, confidence, 5.0) for other in others)
    one = Alignment(
        "correlation", accepted, "", motion, agreed_wall_m=10.0, confidence=confidence, alternatives=alternatives
    )
    return {(target, source): one}


def with_deviation(alignments, deviation):
    covariance = tuple(map(tuple, np.diag([1.0, 1.0, 1e-4]) * deviation**2))
    return {pair: replace(one, covariance=covariance) for pair, one in alignments.items()}


def assert_poses(group, expected, within=1e-6):
    assert list(group.poses) == list(expected)
    for name, pose in expected.items():
        assert group.poses[name] == pytest.approx(pose, rel=1e-6, abs=within)


def test_a_chain_is_one_group_in_the_frame_of_the_first():
    groups = groups_of(list("abcd"), found("a", "c") | found("b", "c") | found("b", "d"))
    assert len(groups) == 1
    assert_poses(groups[0], POSES)


def test_refused_alignments_connect_nothing():
    groups = groups_of(list("ab"), found("a", "b", accepted=False))
    assert [list(group.poses) for group in groups] == [["a"], ["b"]]


def test_of_forty_maps_the_one_false_alignment_is_outvoted_at_once():
    places = {number: SE2(float(number), 0.5 * number, 0.1 * number) for number in range(40)}
    config, edges = GraphConfig(), []
    for target, source in itertools.combinations(places, 2):  # 78 million threes of alignments, minutes to look at all
        motion = SE2(30.0, 0.0, 0.0) if (target, source) == (7, 21) else places[target].inverse() @ places[source]
        (pair, one), *_ = found(str(target), str(source), T=motion).items()
        edges += edges_of(pair, one, config)
    kept = _without_outvoted(edges, config)
    assert [edge for edge in edges if edge not in kept] == [one for one in edges if one.pair == ("7", "21")]
    assert len(kept) == len(edges) - 1


def test_a_group_of_known_poses_is_first_and_is_kept_against_evidence():
    against = found("b", "c") | found("c", "d") | found("a", "b", T=SE2(20.0, 0.0, 0.0))
    places = {name: POSES["b"].inverse() @ POSES[name] for name in ("b", "d")}
    elsewhere = {"a": SE2.identity(), "c": SE2(50.0, 0.0, 1.0)}
    groups = groups_of(list("abcd"), found("b", "d"), known=elsewhere)
    assert_poses(groups[0], elsewhere)
    assert_poses(groups[1], places)
    groups = groups_of(list("abcd"), against, known={"a": SE2.identity(), "b": POSES["b"]})
    assert_poses(groups[0], POSES)
    assert groups[0].outvoted == (("a", "b"),)


def test_the_largest_group_is_first_and_has_its_own_frame():
    groups = groups_of(list("abcd"), found("b", "c") | found("c", "d"))
    assert groups[0].first == "b"
    assert_poses(groups[0], {name: POSES["b"].inverse() @ POSES[name] for name in "bcd"})
    assert list(groups[1].poses) == ["a"]


def test_groups_of_one_size_keep_the_order_of_their_maps():
    groups = groups_of(list("abcd"), found("c", "d") | found("a", "b"))
    assert [list(group.poses) for group in groups] == [["a", "b"], ["c", "d"]]


def test_a_wrong_alignment_is_outvoted():
    wrong = found("a", "b", confidence=0.99, T=SE2(77.0, 0.0, 0.0))
    right = found("a", "c") | found("b", "c") | found("a", "d") | found("b", "d")
    groups = groups_of(list("abcd"), wrong | right)
    assert_poses(groups[0], POSES)
    assert groups[0].outvoted == (("a", "b"),)
    assert set(groups[0].used) == set(right)


def test_two_contradicting_alignments_join_nothing_that_they_contradict():
    wrong = found("a", "c", T=SE2(77.0, 0.0, 0.0))
    groups = groups_of(list("abc"), wrong | found("a", "b", confidence=0.99) | found("b", "c"))
    assert [list(group.poses) for group in groups] == [["a", "b"], ["c"]]


def test_likely_places_that_agree_are_believed_together():
    likely = found("a", "c", 0.84, accepted=False) | found("b", "c", 0.8, accepted=False)
    assert len(groups_of(list("abc"), found("a", "b") | likely)[0]) == 3
    alone = found("a", "c", 0.84, accepted=False)
    assert len(groups_of(list("abc"), found("a", "b") | alone)[0]) == 2


def test_many_maps_of_one_place_are_no_more_sure_of_a_stranger_than_one():
    """Nine robots at one end of a building take its other end, where rooms look alike, for the same wrong place."""
    here = {name: SE2(0.1 * number, 0.0, 0.0) for number, name in enumerate("abcdefghi")}
    alignments = {}
    for target, source in itertools.combinations(here, 2):
        alignments |= found(target, source, 0.99, T=here[target].inverse() @ here[source])
    for name, pose in here.items():
        alignments |= found(name, "z", 0.6, accepted=False, T=pose.inverse() @ SE2(5.0, 0.0, 0.0))
    assert [len(group) for group in groups_of([*here, "z"], alignments)] == [9, 1]


def test_an_accepted_alignment_outweighs_several_consistent_refused_alignments():
    """A building turned by half a circle nearly is the same: all maps of it take a bent one so, the one like it not."""
    turned = SE2(2.0, 2.0, math.pi)
    alignments = found("a", "b", 0.99) | found("a", "c", 0.99) | found("b", "c", 0.99) | found("c", "d", 0.96)
    for name, confidence in (("a", 0.75), ("b", 0.8)):
        wrong = POSES[name].inverse() @ turned @ POSES["d"]
        alignments |= found(name, "d", confidence, accepted=False, T=wrong)
    assert_poses(groups_of(list("abcd"), alignments)[0], POSES)


def test_an_ambiguous_alignment_is_decided_by_the_others():
    turned = SE2(3.0, 3.0, 3.0)
    true = POSES["a"].inverse() @ POSES["c"]
    ambiguous = found("a", "c", 0.45, accepted=False, T=turned, others=[true])
    groups = groups_of(list("abc"), found("a", "b") | found("b", "c") | ambiguous)
    assert_poses(groups[0], {name: POSES[name] for name in "abc"})


def test_small_errors_are_shared_around_a_cycle():
    off = POSES["a"].inverse() @ POSES["c"] @ SE2(0.06, 0.0, 0.0)
    group = groups_of(list("abc"), found("a", "b") | found("b", "c") | found("a", "c", T=off))[0]
    error = POSES["c"].inverse() @ group.poses["c"]
    assert 0.03 < error.x < 0.05  # two edges of three say nothing of it
    assert group.outvoted == ()


SPREAD = (np.array([0.02, 0.02, 0.01]) ** 2 * np.eye(3)).tolist()


def in_frames(alignments, origins):
    """The same alignments, by what is at the maps' centroids, where these lie elsewhere in their frames."""
    return {
        (target, source): replace(
            one,
            T_target_source=origins[target] @ one.T_target_source @ origins[source].inverse(),
            covariance=seen_from(SPREAD, origins[source]),
        )
        for (target, source), one in alignments.items()
    }


@pytest.mark.parametrize("far_m", [0.0, 300.0, 30_000.0])
def test_it_does_not_matter_where_the_frames_of_maps_have_their_origins(far_m):
    """Half a degree that alignments differ by is 3 m at 300 m."""
    origins = {name: SE2(far_m * index, -far_m, 0.3 * index) for index, name in enumerate("abcd")}
    bent = POSES["a"].inverse() @ POSES["c"] @ SE2(0.1, 0.0, 0.01)
    wrong = found("a", "d", confidence=0.99, T=SE2(77.0, 0.0, 0.0))
    right = found("a", "b") | found("b", "c") | found("a", "c", T=bent) | found("b", "d") | found("c", "d")
    group = groups_of(list("abcd"), in_frames(wrong | right, origins))[0]
    assert set(group.used) == set(right)
    assert group.outvoted == (("a", "d"),)
    centroids = {name: origins["a"].inverse() @ pose @ origins[name] for name, pose in group.poses.items()}
    for name, pose in centroids.items():
        assert math.dist(pose[:2], POSES[name][:2]) < 0.2
        assert pose.theta == pytest.approx(POSES[name].theta, abs=0.02)


def test_what_hardly_can_be_right_joins_nothing_though_chance_leads_it_round_a_circle():
    """Of six maps of six buildings some three do so; their places are among some hundred each."""
    doubtful = {pair: one for p, *pair in ((0.07, "a", "b"), (0.02, "a", "c"), (0.004, "b", "c"), (0.03, "a", "d"),
                                           (0.01, "b", "d"), (0.02, "c", "d"))
                for pair, one in found(*pair, p, accepted=False).items()}  # fmt: skip
    assert all(len(group) == 1 for group in groups_of(list("abcd"), doubtful))


def test_what_may_be_right_is_joined_where_others_lead_there_too():
    likely = found("a", "b", 0.84, accepted=False) | found("a", "c", 0.84, accepted=False)
    assert all(len(group) == 1 for group in groups_of(list("abc"), likely))
    assert len(groups_of(list("abc"), likely | found("b", "c", 0.84, accepted=False))) == 1


def test_maps_of_next_to_nothing_lie_on_one_another_and_are_not_joined():
    names = [str(number) for number in range(30)]
    nothing = {
        pair: Alignment("correlation", False, "", SE2.identity(), confidence=0.03)
        for pair in itertools.combinations(names, 2)
    }
    assert len(groups_of(names, nothing)) == 30


def test_an_alignment_that_hardly_can_be_right_moves_no_map():
    off = POSES["a"].inverse() @ POSES["c"] @ SE2(0.6, 0.0, 0.0)
    sure = found("a", "b") | found("b", "c")
    doubted = groups_of(list("abc"), sure | found("a", "c", 0.005, accepted=False, T=off))[0]
    assert_poses(doubted, {name: POSES[name] for name in "abc"}, within=0.01)


def test_the_more_exact_alignment_moves_a_map_more():
    off = POSES["a"].inverse() @ POSES["c"] @ SE2(0.06, 0.0, 0.0)
    sure = with_deviation(found("a", "b") | found("b", "c"), 0.1)
    moved = [
        POSES["c"].inverse()
        @ groups_of(list("abc"), sure | with_deviation(found("a", "c", T=off), deviation))[0].poses["c"]
        for deviation in (0.5, 0.01)
    ]
    assert moved[0].x < 0.01
    assert moved[1].x > 0.05
