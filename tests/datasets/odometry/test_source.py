"""Chains of tf edges, some of which turn while the robot drives, multiplied out by matrices beside."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from datasets.odometry.frames import FrameGraph, Frames
from datasets.odometry.se3 import SE3
from datasets.odometry.source import Mounting, TfMotion


def spatial(x, y, z, *, roll=0.0, pitch=0.0, yaw=0.0):
    return SE3(x, y, z, *Rotation.from_euler("zyx", [yaw, pitch, roll]).as_quat().tolist())


def matrix(pose):
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return whole


def planar(whole):
    return whole[0, 3], whole[1, 3], np.arctan2(whole[1, 0], whole[0, 0])


# The PR2's torso and head, all of them shifted and turned; the laser's own frame is stated the wrong way round.
CHAIN = {
    ("base", "torso"): spatial(-0.05, 0.02, 0.8, yaw=0.4),
    ("torso", "neck"): spatial(0.1, -0.3, 0.2, yaw=-0.9, roll=0.2),
    ("laser", "neck"): spatial(0.25, 0.1, -0.1, yaw=0.7, pitch=0.1),
}
NECK_LATER = spatial(0.15, -0.2, 0.2, yaw=1.1, roll=0.2)


def graph_of(edges, moving=()):
    graph = FrameGraph()
    for (parent, child), pose in edges.items():
        for k in range(2 if (parent, child) in moving else 1):
            graph.add(parent, child, pose if k == 0 else NECK_LATER, (parent, child) not in moving, 0.0)
    return graph


@pytest.mark.parametrize("moves", [False, True])
def test_the_laser_lies_where_the_product_of_its_joints_says(moves):
    joint = ("torso", "neck")
    mounting = Mounting(graph_of(CHAIN, [joint] if moves else []).path("base", "laser"), None, None)
    mounting.add("/other", "/neck", 5.0, SE3.identity())
    if moves:
        mounting.add("/torso", "neck", 1.0, CHAIN[joint])
        mounting.add("/torso", "neck", 9.0, NECK_LATER)
    for stamp, neck in ((1.0, CHAIN[joint]), (9.0, NECK_LATER if moves else CHAIN[joint])):
        expected = matrix(CHAIN["base", "torso"]) @ matrix(neck) @ np.linalg.inv(matrix(CHAIN["laser", "neck"]))
        pose, upside_down = mounting.at(stamp)
        np.testing.assert_allclose(pose, planar(expected), atol=1e-9)
        assert not upside_down


def test_odometry_is_the_product_of_the_way_to_the_robot():
    """A fixed edge lies between two that move, and the last is stated the wrong way round."""
    edges = {
        ("odom", "wheels"): spatial(3.0, -1.0, 0.0, yaw=0.5),
        ("wheels", "chassis"): spatial(0.4, 0.1, 0.1, yaw=-0.3),
        ("robot", "chassis"): spatial(0.2, -0.6, 0.0, yaw=2.0),
    }
    moving = [("odom", "wheels"), ("robot", "chassis")]
    path = graph_of(edges, moving).path("odom", "robot")
    motion = TfMotion(Frames("odom", "robot", path, []), Mounting(None, None, None))
    assert len(motion.histories()) == 2
    now = [spatial(5.0, 2.0, 0.0, yaw=-1.2), spatial(-0.1, 0.7, 0.0, yaw=0.8)]
    expected = matrix(now[0]) @ matrix(edges["wheels", "chassis"]) @ np.linalg.inv(matrix(now[1]))
    np.testing.assert_allclose(motion.odometry(now), planar(expected), atol=1e-9)
