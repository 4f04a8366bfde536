"""Poses and measured motions between them, brought to agree as well as they can.

Built on GTSAM (Dellaert and Kaess, "Factor graphs for robot perception", 2017).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import SE2, FloatArray, compose, inverse, log


@dataclass(frozen=True, eq=False)
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


class PoseGraph:
    """Finds the poses that agree best with all edges; what it made of closures it keeps for the next time.

    Parameters
    ----------
    robust_width
        Width of the Cauchy kernel [standard deviations]: closures lose their say beyond it, so that a false one cannot
        bend the map.
    """

    def __init__(self, robust_width: float) -> None:
        self._robust = gtsam.noiseModel.mEstimator.Cauchy.Create(robust_width)
        self._factors: dict[MotionEdge, gtsam.BetweenFactorPose2] = {}

    def solve(
        self,
        poses: FloatArray,
        nodes: npt.NDArray[np.int64],
        chain: Iterable[MotionEdge],
        closures: Iterable[MotionEdge],
        precision: float = 1e-4,
    ) -> FloatArray:
        """Return the poses (M, 3) of some nodes, the first of which stays where it is.

        Parameters
        ----------
        poses
            Initial poses (N, 3): x [m], y [m], theta [rad].
        nodes
            Rising indices (M,) of those to solve for.
        chain
            Motions between consecutive nodes, which connect all of them and are believed.
        closures
            Motions between nodes that saw the same place.
        precision
            Share of the error below which a further step is not worth its time.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        keys = nodes.tolist()
        for key, pose in zip(keys, poses[nodes].tolist(), strict=True):
            values.insert(key, gtsam.Pose2(*pose))
        first = gtsam.noiseModel.Diagonal.Sigmas(np.full(3, 1e-6))
        graph.add(gtsam.PriorFactorPose2(keys[0], values.atPose2(keys[0]), first))
        for edge in chain:
            graph.add(_factor(edge, gtsam.noiseModel.Gaussian.Information(edge.information)))
        for edge in closures:
            graph.add(self._closure(edge))
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(30)
        parameters.setRelativeErrorTol(precision)
        solved = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
        moved: FloatArray = gtsam.utilities.extractPose2(solved)
        return moved

    def _closure(self, edge: MotionEdge) -> "gtsam.BetweenFactorPose2":
        factor = self._factors.get(edge)
        if factor is None:
            noise = gtsam.noiseModel.Gaussian.Information(edge.information)
            factor = self._factors[edge] = _factor(edge, gtsam.noiseModel.Robust.Create(self._robust, noise))
        return factor


def optimise(poses: FloatArray, chain: list[MotionEdge], closures: list[MotionEdge], robust_width: float) -> FloatArray:
    """Return all poses (N, 3) that agree best with all edges; see `PoseGraph`."""
    if len(poses) == 0:
        return poses
    return PoseGraph(robust_width).solve(poses, np.arange(len(poses)), chain, closures)


def _factor(edge: MotionEdge, noise: "gtsam.noiseModel.Base") -> "gtsam.BetweenFactorPose2":
    return gtsam.BetweenFactorPose2(edge.source, edge.target, gtsam.Pose2(*edge.T_source_target), noise)


def relative_pose(poses: FloatArray, source: int, target: int) -> SE2:
    """Return one pose of (N, 3) as seen from another."""
    return SE2(*poses[source].tolist()).to(SE2(*poses[target].tolist()))


def edge_errors(edges: Sequence[MotionEdge], poses: FloatArray) -> FloatArray:
    """Return how many standard deviations edges (E,) are from the poses (Mahalanobis distances)."""
    ends = np.array([(edge.source, edge.target) for edge in edges], dtype=np.int64).reshape(-1, 2)
    measured = np.array([edge.T_source_target for edge in edges], dtype=np.float64).reshape(-1, 3)
    information = np.array([edge.information for edge in edges], dtype=np.float64).reshape(-1, 3, 3)
    motions = compose(inverse(poses[ends[:, 0]]), poses[ends[:, 1]])
    errors = log(compose(inverse(measured), motions))
    squares: FloatArray = np.einsum("ei,eij,ej->e", errors, information, errors)
    return np.sqrt(squares)
