import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.optimisation.pose_graph import MotionEdge, edge_errors, relative_pose


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
