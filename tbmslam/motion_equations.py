"""Measured motions between poses as linear equations of small changes of the poses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse

from tbmslam.pose_graph import MotionEdge
from tbmslam.se2 import FloatArray, wrap_angles


@dataclass(frozen=True)
class MotionEquations:
    """Measured motions between points of view that hang on poses.

    Parameters
    ----------
    ends
        The poses (E, 2) that the motions' sources and targets hang on.
    levers
        Where on them, (E, 2, 3): the point of view in the frame of its pose.
    motions
        The measured motions (E, 3).
    informations
        Inverse covariances (E, 3, 3) of an error in the target's frame.
    """

    ends: npt.NDArray[np.int64]
    levers: FloatArray
    motions: FloatArray
    informations: FloatArray

    @classmethod
    def of(cls, edges: Sequence[MotionEdge], owners: npt.NDArray[np.int64], places: FloatArray) -> "MotionEquations":
        """Make equations of edges between points of view (K,) that hang on poses `owners` at `places` (K, 3)."""
        ends = np.array([(edge.source, edge.target) for edge in edges], dtype=np.int64).reshape(-1, 2)
        motions = np.array([edge.T_source_target for edge in edges], dtype=np.float64).reshape(-1, 3)
        informations = np.array([edge.information for edge in edges], dtype=np.float64).reshape(-1, 3, 3)
        return cls(owners[ends], places[ends], motions, informations)

    def system(self, poses: FloatArray, width: float | None) -> tuple[sparse.csr_array, FloatArray]:
        """Return the curvature (3 N, 3 N) and the gradient (N, 3) at poses (N, 3).

        Changes of a pose are dx, dy in the map's frame and dtheta about its own place.

        Parameters
        ----------
        poses
            x [m], y [m], theta [rad].
        width
            Standard deviations at which a motion begins to lose its say (Cauchy); None where all are believed.
        """
        count, edges = len(poses), len(self.ends)
        errors, slopes = self._linearised(poses)
        weights = self.informations
        if width is not None:
            squares = np.einsum("ei,eij,ej->e", errors, weights, errors)
            weights = weights / (1.0 + squares / width**2)[:, None, None]
        blocks = np.einsum("eaki,ekl,eblj->eabij", slopes, weights, slopes)
        gradient = np.zeros((count, 3))
        np.add.at(gradient, self.ends, np.einsum("eaki,ekl,el->eai", slopes, weights, errors))
        axes = 3 * self.ends[:, :, None] + np.arange(3)
        shape = (edges, 2, 2, 3, 3)
        rows = np.broadcast_to(axes[:, :, None, :, None], shape)
        cols = np.broadcast_to(axes[:, None, :, None, :], shape)
        matrix = sparse.coo_array((blocks.ravel(), (rows.ravel(), cols.ravel())), shape=(3 * count, 3 * count))
        return matrix.tocsr(), gradient

    def _linearised(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the errors (E, 3) and their derivatives (E, 2, 3, 3) by the changes of both ends' poses."""
        at = poses[self.ends]
        cosine, sine = np.cos(at[..., 2]), np.sin(at[..., 2])
        x, y = self.levers[..., 0], self.levers[..., 1]
        arms = np.stack((cosine * x - sine * y, sine * x + cosine * y), axis=-1)
        views = at[..., :2] + arms
        heading = at[:, 0, 2] + self.levers[:, 0, 2]
        cosine, sine = np.cos(heading), np.sin(heading)
        to_source = np.stack((np.stack((cosine, sine), -1), np.stack((-sine, cosine), -1)), -2)
        way = views[:, 1] - views[:, 0]
        seen = np.einsum("eij,ej->ei", to_source, way) - self.motions[:, :2]
        turn = wrap_angles(at[:, 1, 2] + self.levers[:, 1, 2] - heading - self.motions[:, 2])
        # Errors are told in the measured target's frame.
        cosine, sine = np.cos(self.motions[:, 2]), np.sin(self.motions[:, 2])
        to_target = np.stack((np.stack((cosine, sine), -1), np.stack((-sine, cosine), -1)), -2)
        turned = to_target @ to_source
        errors = np.column_stack((np.einsum("eij,ej->ei", to_target, seen), turn))
        slopes = np.zeros((len(errors), 2, 3, 3))
        slopes[:, 0, :2, :2], slopes[:, 1, :2, :2] = -turned, turned
        slopes[:, 0, 2, 2], slopes[:, 1, 2, 2] = -1.0, 1.0
        # The source's turn moves its own point of view and swings what it sees.
        for end, arm, sign in ((0, arms[:, 0] + way, -1.0), (1, arms[:, 1], 1.0)):
            swing = np.stack((-arm[:, 1], arm[:, 0]), axis=-1)
            slopes[:, end, :2, 2] = sign * np.einsum("eij,ej->ei", turned, swing)
        return errors, slopes
