"""The edges of a pose graph: measured motions between poses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
