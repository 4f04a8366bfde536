"""How far a pose of a pose graph may be off as seen from another one."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from tbmslam.geometry.se2 import FloatArray, adjoints, compose, inverse
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionEdge, edge_errors

_GAUGE = 1e12
"""Information that holds the source where it is [1/m^2, 1/rad^2]."""


def relative_covariance(
    poses: FloatArray,
    chain: Sequence[MotionEdge],
    closures: Sequence[MotionEdge],
    robust_width: float,
    source: int,
    target: int,
) -> FloatArray:
    """Return the covariance (3, 3) of one pose as seen from another, in the frame of the former.

    It is a block of the inverse of the Gauss-Newton matrix (Kaess and Dellaert, "Covariance recovery from a square root
    information matrix for data association", 2009).

    Parameters
    ----------
    poses
        Poses (N, 3): x [m], y [m], theta [rad].
    chain
        Motions which are believed. Chain and closures together connect source and target.
    closures
        Motions that count the less the more standard deviations they are from the poses.
    robust_width
        Width of their Cauchy kernel [standard deviations].
    source, target
        Indices of the pose that is held and of the pose in question.
    """
    ends, _, informations = EdgeArrays.of([*chain, *closures])
    if closures:
        informations[len(chain) :] /= (1.0 + (edge_errors(closures, poses) / robust_width) ** 2)[:, None, None]
    nodes, numbers = np.unique(ends, return_inverse=True)
    numbers = numbers.reshape(-1, 2)
    # An error in the target's frame: as the target moves, less what the source's motion moves there.
    at_source = -adjoints(compose(inverse(poses[ends[:, 1]]), poses[ends[:, 0]]))
    crossed = np.swapaxes(at_source, 1, 2) @ informations
    blocks = [crossed @ at_source, crossed, np.swapaxes(crossed, 1, 2), informations]
    rows, columns = numbers[:, [0, 0, 1, 1]], numbers[:, [0, 1, 0, 1]]
    system = _assembled(rows.T.ravel(), columns.T.ravel(), np.concatenate(blocks), len(nodes))
    held, asked = 3 * int(np.searchsorted(nodes, source)), 3 * int(np.searchsorted(nodes, target))
    gauge, right = np.zeros(3 * len(nodes)), np.zeros((3 * len(nodes), 3))
    gauge[held : held + 3] = _GAUGE
    right[asked : asked + 3] = np.eye(3)
    system.setdiag(system.diagonal() + gauge)
    covariance: FloatArray = splu(system.tocsc()).solve(right)[asked : asked + 3]
    return covariance


def _assembled(
    rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], blocks: FloatArray, size: int
) -> "coo_array":
    """Return the sparse matrix (3 size, 3 size) that blocks (B, 3, 3) at block rows and columns (B,) add up to."""
    inner = np.arange(3)
    at = 3 * rows[:, None, None] + inner[:, None], 3 * columns[:, None, None] + inner[None, :]
    row, column = (np.broadcast_to(each, blocks.shape).ravel() for each in at)
    return coo_array((blocks.ravel(), (row, column)), shape=(3 * size, 3 * size))
