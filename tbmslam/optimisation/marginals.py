"""How far a pose of a pose graph may be off as seen from another one."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.adjustment.motion_systems import motion_equations
from tbmslam.kernels.adjustment.pose_systems import MotionSystem
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.optimisation.pose_solver import motions_of

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
    nodes = np.unique([end for edge in (*chain, *closures) for end in (edge.source, edge.target)])
    numbers = np.zeros(len(poses), dtype=np.int64)
    numbers[nodes] = np.arange(len(nodes))
    motions = motions_of(chain, closures, robust_width, numbers, np.zeros((len(poses), 3)))
    own, system, _ = motion_equations(motions, poses[nodes])
    held, asked = numbers[source], numbers[target]
    own[held] += _GAUGE * np.eye(3)
    right = np.zeros((3 * len(nodes), 3))
    right[3 * asked : 3 * asked + 3] = np.eye(3)
    in_map = splu(_matrix(own, system)).solve(right)[3 * asked : 3 * asked + 3]
    rotation = SE2(0.0, 0.0, float(poses[target, 2])).matrix()
    covariance: FloatArray = rotation.T @ in_map @ rotation
    return covariance


def _matrix(own: FloatArray, system: MotionSystem) -> csc_array:
    """Return the sparse matrix (3 N, 3 N) of the curvature of poses (N, 3, 3) and of the motions between them."""
    sources, targets = system.ends.T
    every, inner = np.arange(len(own)), np.arange(3)
    blocks = np.concatenate((own, system.across, np.swapaxes(system.across, 1, 2)))
    rows = 3 * np.concatenate((every, sources, targets))[:, None, None] + inner[:, None]
    columns = 3 * np.concatenate((every, targets, sources))[:, None, None] + inner
    row, column = (np.broadcast_to(each, blocks.shape).ravel() for each in (rows, columns))
    return coo_array((blocks.ravel(), (row, column)), shape=(3 * len(own), 3 * len(own))).tocsc()
