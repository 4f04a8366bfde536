import itertools
import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merging.alignment import Alignment, PoseHypothesis, seen_from
from merging.config.groups import GraphConfig
from merging.map_graph.grouping import groups_of
from merging.map_graph.links import CentroidFrames, Edge, GroupLinks, _are_same, edges_of, is_same_pose
from tbmslam.geometry.se2 import SE2
from tests.merging.map_graph.slow_links import slow_links_of

CONFIG = GraphConfig()


def crowd(count, rng, wrong=0.0, others=1):
    """Alignments of every pair of so many maps: most right, each with alternatives that lead nowhere."""
    places = {str(number): anywhere(rng) for number in range(count)}
    alignments = {}
    for target, source in itertools.combinations(places, 2):
        motion = places[target].inverse() @ places[source] @ SE2(*rng.normal(0.0, (0.03, 0.03, 0.003)))
        motion = anywhere(rng) if rng.random() < wrong else motion
        accepted = bool(rng.random() < 0.8)
        alignments[target, source] = Alignment(
            "correlation",
            accepted,
            "",
            motion,
            agreed_wall_m=float(rng.uniform(5.0, 50.0)),
            confidence=float(rng.uniform(0.8, 1.0) if accepted else rng.uniform(0.0, 0.8)),
            alternatives=tuple(PoseHypothesis(anywhere(rng), float(rng.uniform(0.0, 0.6)), 5.0) for _ in range(others)),
        )
    return places, alignments


def anywhere(rng):
    return SE2(*rng.uniform((-30.0, -30.0, -math.pi), (30.0, 30.0, math.pi)).tolist())


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(2, 9), wrong=st.sampled_from([0.0, 0.2, 0.6]))
def test_links_are_those_of_the_slow_twin_after_every_join(seed, count, wrong):
    rng = np.random.default_rng(seed)
    places, alignments = crowd(count, rng, wrong)
    edges = [edge for pair, found in alignments.items() for edge in edges_of(pair, found, CONFIG)]
    groups = [{} for _ in range(int(rng.integers(1, count + 1)))]
    for name, place in places.items():
        groups[int(rng.integers(len(groups)))][name] = place
    links = GroupLinks(groups, edges, CONFIG)
    assert_same(links.all(), slow_links_of(groups, edges, CONFIG))
    while found := links.all():
        links.join(found[int(rng.integers(len(found)))])
        assert_same(links.all(), slow_links_of(groups, edges, CONFIG))
    assert sum(len(group) for group in groups) == count


def assert_same(found, expected):
    assert [link[1:4] for link in found] == [link[1:4] for link in expected]
    assert [link.support for link in found] == pytest.approx([link[0] for link in expected])
    assert [link.motion for link in found] == [link[4] for link in expected]


def test_forty_maps_that_all_align_are_grouped_in_seconds():
    places, alignments = crowd(40, np.random.default_rng(1), others=0)
    begin = time.process_time()
    groups = groups_of(list(places), alignments)
    assert time.process_time() - begin < 30.0  # one after another, the places and ways took minutes
    assert len(groups) == 1
    start = places["0"].inverse()
    for name, pose in groups[0].poses.items():
        assert pose == pytest.approx(start @ places[name], abs=0.1)


def test_places_are_the_same_up_to_a_whole_turn():
    here = np.array([[1.0, 2.0, math.pi - 0.001]])
    turned = np.array([[1.0, 2.0, theta] for theta in (math.pi - 0.002, -math.pi + 0.001, 2.0, 0.0, -2.0)])
    assert _are_same(here, turned, CONFIG).tolist() == [[True, True, False, False, False]]
    away = np.array([[1.0 + 2.0 * CONFIG.same_m, 2.0, math.pi - 0.001]])
    assert not _are_same(here, away, CONFIG).any()


GRAPH = GraphConfig()
FAR = SE2(400.0, 0.0, 0.0)
KNOWN_FAR = seen_from((np.array([0.02, 0.02, 0.01]) ** 2 * np.eye(3)).tolist(), FAR)


def test_places_are_compared_where_they_are_known():
    turned = FAR @ SE2(0.0, 0.0, 0.01) @ FAR.inverse()
    assert is_same_pose(SE2.identity(), turned, GRAPH, KNOWN_FAR)
    assert not is_same_pose(SE2.identity(), turned, GRAPH)
    about_the_origin = SE2(0.0, 0.0, 0.01)
    assert is_same_pose(SE2.identity(), about_the_origin, GRAPH)
    assert not is_same_pose(SE2.identity(), about_the_origin, GRAPH, KNOWN_FAR)


def test_another_place_or_another_turn_is_not_the_same():
    assert not is_same_pose(SE2.identity(), SE2(GRAPH.same_m + 0.01, 0.0, 0.0), GRAPH)
    assert not is_same_pose(SE2.identity(), SE2(0.0, 0.0, GRAPH.same_rad + 0.01), GRAPH)
    assert is_same_pose(SE2(0.0, 0.0, 3.14), SE2(0.0, 0.0, -3.14), GRAPH)


SPREAD = (np.array([0.02, 0.02, 0.01]) ** 2 * np.eye(3)).tolist()
ABOUT = SE2(200.0, -70.0, 0.0)
MOTION = SE2(5.0, 3.0, 1.0)


def edge(covariance, pair=("a", "b")):
    return Edge(pair, PoseHypothesis(MOTION, 0.7, 10.0, covariance, accepted=True))


def test_the_centroids_are_where_alignments_know_best():
    one = edge(seen_from(SPREAD, ABOUT))
    centroids = CentroidFrames([one])
    assert centroids.of("b") == pytest.approx(ABOUT)
    assert centroids.of("a")[:2] == pytest.approx(MOTION.apply(ABOUT[:2]))
    between = centroids.between(one)
    assert between.motion == pytest.approx(SE2(0.0, 0.0, MOTION.theta), abs=1e-9)
    np.testing.assert_allclose(between.hypothesis.covariance, SPREAD, atol=1e-9)


def test_several_alignments_make_one_centroid():
    other = SE2(100.0, 30.0, 0.0)
    centroids = CentroidFrames([edge(seen_from(SPREAD, ABOUT)), edge(seen_from(SPREAD, other), ("c", "b"))])
    assert centroids.of("b") == pytest.approx(SE2(150.0, -20.0, 0.0))


def test_a_map_without_alignments_keeps_its_frame():
    one = edge(None)
    assert CentroidFrames([one]).of("a") == SE2.identity()
    assert CentroidFrames([one]).between(one) == one


def test_centred_groups_are_restored():
    centroids = CentroidFrames([edge(seen_from(SPREAD, ABOUT))])
    poses = {"a": SE2(1.0, 2.0, 0.5), "b": SE2(-4.0, 0.0, 2.0), "d": SE2(7.0, 7.0, 0.0)}
    inside = centroids.group(poses)
    assert inside["b"] == pytest.approx((poses["a"] @ centroids.of("a")).inverse() @ poses["b"] @ centroids.of("b"))
    assert inside["a"] == pytest.approx(SE2.identity(), abs=1e-9)
    back = centroids.maps(inside)
    for name, pose in poses.items():
        assert back[name] == pytest.approx(poses["a"].inverse() @ pose)


def test_alternatives_of_an_accepted_place_are_not_accepted():
    others = tuple(PoseHypothesis(SE2(float(k), 0.0, 0.0), 0.3, 30.0) for k in (1, 2))
    found = Alignment("correlation", True, "", MOTION, agreed_wall_m=40.0, confidence=0.99, alternatives=others)
    edges = edges_of(("a", "b"), found, GRAPH)
    assert [found.hypothesis.accepted for found in edges] == [True, False, False]
    assert [found.motion for found in edges] == [MOTION, *(one.T_target_source for one in others)]
    assert edges[0].probability == pytest.approx(0.99)
    assert edges[1].probability == pytest.approx(0.3)
