import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.optimisation.pose_graph import MotionEdge, PoseGraph, edge_errors, optimise, relative_pose

SURE = np.diag([1e4, 1e4, 1e5])


def square(count=40, drift=0.0):
    """Poses around a square, each step turned a little too far, and the true poses."""
    true, drifted = [SE2.identity()], [SE2.identity()]
    for number in range(count):
        step = SE2(1.0, 0.0, np.pi / 2 if number % 10 == 9 else 0.0)
        true.append(true[-1] @ step)
        drifted.append(drifted[-1] @ SE2(step.x, step.y, step.theta + drift))
    return np.array(true), np.array(drifted)


def chain_of(poses, information):
    return [MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), information) for k in range(len(poses) - 1)]


def test_a_closure_takes_the_drift_back():
    true, drifted = square(drift=0.003)
    chain = chain_of(drifted, np.diag([1e4, 1e4, 1e4]))
    closure = MotionEdge(0, 40, SE2.identity(), SURE)
    solved = optimise(drifted, chain, [closure], 2.0)
    assert np.hypot(*(drifted - true)[40, :2]) > 0.5
    assert np.hypot(*(solved - true)[40, :2]) < 0.05
    assert np.hypot(*(solved - true)[:, :2].T).max() < 0.5 * np.hypot(*(drifted - true)[:, :2].T).max()
    np.testing.assert_allclose(solved[0], 0.0, atol=1e-6)


def test_a_false_closure_does_not_bend_the_map():
    true, _ = square()
    chain = chain_of(true, SURE)
    good = [MotionEdge(k, 40 - k, relative_pose(true, k, 40 - k), SURE) for k in range(5)]
    false = MotionEdge(0, 20, SE2.identity(), SURE)
    solved = optimise(true, chain, [*good, false], 2.0)
    assert np.hypot(*(solved - true)[:, :2].T).max() < 0.05
    assert edge_errors([false], solved)[0] > 100.0


def test_error_counts_standard_deviations():
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    edge = MotionEdge(0, 1, SE2(0.7, 0.0, 0.0), np.diag([100.0, 1.0, 1.0]))
    assert edge_errors([edge], poses) == pytest.approx(3.0)


def test_errors_are_those_of_the_logarithm(generator):
    poses = generator.normal(0.0, 2.0, (20, 3))
    edges = []
    for k in range(19):
        root = generator.normal(0.0, 1.0, (3, 3))
        edges.append(MotionEdge(k, k + 1, SE2(*generator.normal(0.0, 1.0, 3)), root @ root.T))
    for edge, error in zip(edges, edge_errors(edges, poses), strict=True):
        twist = np.array((edge.T_source_target.inverse() @ relative_pose(poses, edge.source, edge.target)).log())
        assert error == pytest.approx(np.sqrt(twist @ edge.information @ twist))
    assert edge_errors([], poses).shape == (0,)


def test_solving_again_with_more_closures_is_solving_them_all():
    _, drifted = square(drift=0.003)
    chain = chain_of(drifted, SURE)
    closures = [MotionEdge(0, 40, SE2.identity(), SURE), MotionEdge(5, 38, SE2(1.0, 3.0, 0.2), SURE)]
    graph, nodes = PoseGraph(2.0), np.arange(41)
    graph.solve(drifted, nodes, chain, closures[:1])
    np.testing.assert_array_equal(graph.solve(drifted, nodes, chain, closures), optimise(drifted, chain, closures, 2.0))


def test_no_poses_are_no_trouble():
    assert len(optimise(np.zeros((0, 3)), [], [], 2.0)) == 0
