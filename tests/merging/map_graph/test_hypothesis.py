import numpy as np

from merging.config.map_graph import GraphConfig
from merging.map_graph.hypothesis import is_same_place
from merging.verification.covariance import seen_from
from tbmslam.geometry.se2 import SE2

GRAPH = GraphConfig()
FAR = SE2(400.0, 0.0, 0.0)
KNOWN_FAR = seen_from((np.array([0.02, 0.02, 0.01]) ** 2 * np.eye(3)).tolist(), FAR)


def test_places_are_compared_where_they_are_known():
    turned = FAR @ SE2(0.0, 0.0, 0.01) @ FAR.inverse()
    assert is_same_place(SE2.identity(), turned, GRAPH, KNOWN_FAR)
    assert not is_same_place(SE2.identity(), turned, GRAPH)
    about_the_origin = SE2(0.0, 0.0, 0.01)
    assert is_same_place(SE2.identity(), about_the_origin, GRAPH)
    assert not is_same_place(SE2.identity(), about_the_origin, GRAPH, KNOWN_FAR)


def test_another_place_or_another_turn_is_not_the_same():
    assert not is_same_place(SE2.identity(), SE2(GRAPH.same_m + 0.01, 0.0, 0.0), GRAPH)
    assert not is_same_place(SE2.identity(), SE2(0.0, 0.0, GRAPH.same_rad + 0.01), GRAPH)
    assert is_same_place(SE2(0.0, 0.0, 3.14), SE2(0.0, 0.0, -3.14), GRAPH)
