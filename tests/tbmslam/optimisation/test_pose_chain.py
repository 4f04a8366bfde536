import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge, relative_pose


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
    few = optimise(poses, MotionChain(chain).between(nodes), closures, 1e6, nodes)
    every = optimise(poses, chain, closures, 1e6)
    assert np.abs(every - poses).max() > 0.02
    np.testing.assert_allclose(few, every[nodes], atol=1e-3)


def test_one_node_has_no_motions(drive):
    _, chain, _ = drive
    assert MotionChain(chain).between(np.array([0])) == []
