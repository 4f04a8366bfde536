"""Poses and measured motions between them, brought to agree as well as they can.

Built on GTSAM (Dellaert and Kaess, "Factor graphs for robot perception", 2017).
"""

import math
from dataclasses import dataclass

import gtsam
import numpy as np

from tbmslam.se2 import SE2, FloatArray, wrap_angle


@dataclass(frozen=True)
class MotionEdge:
    """A measured motion between two poses of the graph.

    Parameters
    ----------
    source, target
        Indices of the poses.
    T_source_target
        The target as seen from the source.
    information
        Inverse covariance (3, 3) of an error in x, y [m] and theta [rad] in the target's frame.
    """

    source: int
    target: int
    T_source_target: SE2
    information: FloatArray


def optimise(poses: FloatArray, chain: list[MotionEdge], closures: list[MotionEdge], robust_width: float) -> FloatArray:
    """Return the poses (N, 3) that agree best with all edges.

    The first pose stays where it is. Edges of `chain` are believed; `closures` lose their say beyond `robust_width`
    standard deviations (Cauchy), so that a false one cannot bend the map.

    Parameters
    ----------
    poses
        Initial poses (N, 3): x [m], y [m], theta [rad].
    chain
        Motions between consecutive poses, which connect all of them.
    closures
        Motions between poses that saw the same place.
    robust_width
        Width of the Cauchy kernel [standard deviations].
    """
    if len(poses) == 0:
        return poses
    graph = gtsam.NonlinearFactorGraph()
    first = gtsam.noiseModel.Diagonal.Sigmas(np.full(3, 1e-6))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*poses[0]), first))
    kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(robust_width)
    for edges, robust in ((chain, False), (closures, True)):
        for edge in edges:
            noise = gtsam.noiseModel.Gaussian.Information(edge.information)
            graph.add(
                gtsam.BetweenFactorPose2(
                    edge.source,
                    edge.target,
                    gtsam.Pose2(*edge.T_source_target),
                    gtsam.noiseModel.Robust.Create(kernel, noise) if robust else noise,
                )
            )
    values = gtsam.Values()
    for index, pose in enumerate(poses):
        values.insert(index, gtsam.Pose2(*pose))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(30)
    parameters.setRelativeErrorTol(1e-4)
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    moved: FloatArray = gtsam.utilities.extractPose2(solved)
    return moved


def relative_pose(poses: FloatArray, source: int, target: int) -> SE2:
    """Return one pose of (N, 3) as seen from another."""
    x, y, theta = poses[source].tolist()
    to_x, to_y, to_theta = poses[target].tolist()
    cosine, sine = math.cos(theta), math.sin(theta)
    dx, dy = to_x - x, to_y - y
    return SE2(cosine * dx + sine * dy, cosine * dy - sine * dx, wrap_angle(to_theta - theta))


def edge_error(edge: MotionEdge, poses: FloatArray) -> float:
    """Return how many standard deviations an edge is from the poses (Mahalanobis distance)."""
    error = np.array((edge.T_source_target.inverse() @ relative_pose(poses, edge.source, edge.target)).log())
    return float(np.sqrt(error @ edge.information @ error))
