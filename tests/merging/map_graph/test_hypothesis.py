import numpy as np
import pytest

from merging.alignment import Alignment, PoseHypothesis, seen_from
from merging.config.groups import GraphConfig
from merging.map_graph.links import CentroidFrames, Edge, edges_of, is_same_pose
from tbmslam.geometry.se2 import SE2

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
