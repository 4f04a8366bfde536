import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.loop_closure.closure_graph import ClosureGraph, ClosureGraphConfig
from tbmslam.loop_closure.sequence_consistency import PlacedBundle
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge

INFORMATION = np.diag([400.0, 400.0, 2500.0])
SURE = np.diag([1e6, 1e6, 1e6])


def graph_of(count, step=0.0):
    """Return the graph of a drive straight ahead whose tracked poses err across by 1 cm a keyframe."""
    tracked = np.column_stack([step * np.arange(count), 0.01 * np.arange(count), np.zeros(count)])
    chain = [MotionEdge(k, k + 1, SE2(step, 0.01, 0.0), INFORMATION) for k in range(count - 1)]
    return ClosureGraph(ClosureGraphConfig(), tracked, MotionChain.of(chain))


def test_a_closure_knows_nothing_of_a_direction_that_its_fit_leaves_open():
    """Along a corridor: there the prior of closures must not make up what no laser saw."""
    graph = graph_of(50)
    graph.add([PlacedBundle(40, 0, 3, SE2(1.0, 2.0, np.pi / 2), np.diag([0.0, 1e6, 1e6]))])
    graph.optimise()
    (closure,) = graph.closures.values()
    # The open direction is the map's x, which is the keyframe's -y.
    along, across = closure.information[1, 1], closure.information[0, 0]
    assert along < 0.01
    assert 0.5 * 0.02**-2 < across < 0.02**-2


def test_a_closure_corrects_the_poses_and_is_met_then():
    graph = graph_of(20, step=0.5)
    found = PlacedBundle(19, 0, 0, SE2(9.5, 0.0, 0.0), SURE)
    assert graph.correction_m(found) == pytest.approx(0.19)
    graph.add([found])
    assert not graph.has_met(19, 0)
    graph.optimise()
    assert graph.poses[19] == pytest.approx([9.5, 0.0, 0.0], abs=0.04)
    assert graph.poses[0] == pytest.approx(np.zeros(3), abs=1e-12)
    assert graph.correction_m(found) < 0.04
    graph.add([found._replace(pose=SE2.from_array(graph.poses[19]))])
    graph.optimise()
    assert graph.has_met(19, 0)
    assert len(graph.closures) == 1


def test_far_closures_are_trusted_until_the_poses_have_moved():
    """A robust kernel alone gives closures that are metres off no weight."""
    found = [PlacedBundle(k, 0, 0, SE2(0.5 * k, -6.0, 0.0), SURE) for k in (17, 18, 19)]
    graphs = graph_of(20, step=0.5), graph_of(20, step=0.5)
    for graph in graphs:
        graph.add(found)
    graphs[0].optimise()
    graphs[1].pull_together()
    assert graphs[0].poses[19, 1] > -3.0
    assert graphs[1].poses[19, 1] == pytest.approx(-6.0, abs=0.1)


def test_a_closure_that_contradicts_the_others_is_dropped():
    graph = graph_of(40, step=0.5)
    right = [PlacedBundle(k, 0, 0, SE2(0.5 * k, 0.0, 0.0), SURE) for k in (20, 25, 30, 35, 39)]
    graph.add([*right, PlacedBundle(32, 1, 0, SE2(16.0, 3.0, 0.0), SURE)])
    graph.optimise()
    graph.drop_contradictions()
    assert sorted(graph.closures) == [(k, 0) for k in (20, 25, 30, 35, 39)]
    assert graph.poses[39, 1] == pytest.approx(0.0, abs=0.05)


def test_the_poses_are_as_tracked_after_the_last_closure_was_dropped():
    graph = graph_of(40, step=0.5)
    tracked = graph.poses.copy()
    graph.add([PlacedBundle(39, 0, 0, SE2(19.5, 20.0, 0.0), SURE), PlacedBundle(39, 1, 0, SE2(19.5, -20.0, 0.0), SURE)])
    graph.pull_together()
    assert np.abs(graph.poses - tracked).max() > 0.01
    graph.drop_contradictions()
    assert graph.closures == {}
    np.testing.assert_array_equal(graph.poses, tracked)
