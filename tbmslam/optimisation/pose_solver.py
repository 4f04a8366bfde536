"""Solves the equations of poses by conjugate gradients, for one right side after the other."""

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.adjustment.pose_systems import PoseSystem, times
from tbmslam.kernels.adjustment.two_levels import Bends, factors_of, precondition

_MOST_STEPS = 1000


class PoseSolver:
    """The equations of some poses, ready to be solved.

    Parameters
    ----------
    system
        The equations.
    poses
        The poses (N, 3).
    bends
        Knots along the drives.
    precision
        Share of a right side that may be left unsolved.
    """

    def __init__(self, system: PoseSystem, poses: FloatArray, bends: Bends, precision: float) -> None:
        self._system, self._bends, self._precision = system, bends, precision
        self._factors = factors_of(system, poses, bends)

    def curved(self, changes: FloatArray) -> FloatArray:
        """Return the curvature times changes (N, 3) of the poses."""
        return times(self._system, changes)

    def solved(self, gradient: FloatArray) -> FloatArray:
        """Return the changes (N, 3) of the poses whose curvature product is the gradient (N, 3)."""

        def curved(changes: FloatArray) -> FloatArray:
            return times(self._system, changes.reshape(-1, 3)).ravel()

        def near(forces: FloatArray) -> FloatArray:
            return precondition(self._factors, self._bends, forces.reshape(-1, 3)).ravel()

        shape = (gradient.size, gradient.size)
        known, nearly = (LinearOperator(shape, matvec=part, dtype=np.float64) for part in (curved, near))
        changes, _ = cg(known, gradient.ravel(), rtol=self._precision, maxiter=_MOST_STEPS, M=nearly)
        return np.asarray(changes, dtype=np.float64).reshape(-1, 3)
