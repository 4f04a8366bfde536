import numpy as np
import pytest

from tbmslam.pose_graph import MotionEdge, optimise, relative_pose
from tbmslam.se2 import SE2
from tbmslam.skeleton import Skeleton


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
    skeleton = Skeleton(chain, nodes, poses)
    few = optimise(poses[nodes], skeleton.chain, skeleton.on_nodes(closures), 1e6)
    every = optimise(poses, chain, closures, 1e6)
    assert np.abs(every - poses).max() > 0.02
    np.testing.assert_allclose(few, every[nodes], atol=1e-3)


def test_poses_between_nodes_follow_rigidly(drive):
    poses, chain, _ = drive
    nodes = np.array([0, 20, 40])
    skeleton = Skeleton(chain, nodes, poses)
    np.testing.assert_allclose(skeleton.spread(poses[nodes]), poses, atol=1e-12)
    moved = poses[nodes].copy()
    moved[1] = SE2.from_array(moved[1]) @ SE2(1.0, 2.0, 0.5)
    spread = skeleton.spread(moved)
    np.testing.assert_allclose(spread[:20], poses[:20], atol=1e-12)
    np.testing.assert_allclose(spread[40:], poses[40:], atol=1e-12)
    assert relative_pose(spread, 20, 30) == pytest.approx(relative_pose(poses, 20, 30))
