import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionChain, MotionEdge, edge_errors, relative_pose


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


@pytest.fixture
def drive(generator):
    """A winding chain of 60 poses with uneven information, and two closures."""
    poses = [SE2.identity()]
    for _ in range(59):
        poses.append(poses[-1] @ SE2(0.4, 0.02, float(generator.normal(0.05, 0.1))))
    poses = np.array(poses)
    chain = []
    for k in range(59):
        root = generator.normal(0.0, 1.0, (3, 3)) * [0.01, 0.01, 0.003] + np.diag([0.02, 0.01, 0.005])
        chain.append(MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), np.linalg.inv(root @ root.T)))
    information = np.diag([1e4, 1e4, 1e5])
    closures = [
        MotionEdge(0, 50, relative_pose(poses, 0, 50) @ SE2(0.05, -0.08, 0.02), information),
        MotionEdge(10, 40, relative_pose(poses, 10, 40) @ SE2(0.02, 0.03, -0.01), information),
    ]
    return poses, chain, closures


def test_solving_the_skeleton_is_solving_the_drive(drive):
    poses, chain, closures = drive
    nodes = np.array([0, 10, 23, 40, 50, 59])
    few = optimise(poses, MotionChain.of(chain).between(nodes), closures, 1e6, nodes)
    every = optimise(poses, EdgeArrays.of(chain), closures, 1e6)
    assert np.abs(every - poses).max() > 0.02
    np.testing.assert_allclose(few, every[nodes], atol=1e-3)


def test_one_node_has_no_motions(drive):
    _, chain, _ = drive
    assert MotionChain.of(chain).between(np.array([0])).ends.shape == (0, 2)
