"""How far a drive may have drifted between any two of its keyframes, by the covariances of its motions."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray, inverse
from tbmslam.optimisation.pose_graph import MotionEdge


class ChainDrift:
    """Sums of the covariances along a drive, so that the drift between two keyframes is one difference.

    Parameters
    ----------
    poses
        Poses (K, 3) of the keyframes as tracked.
    chain
        Motions from each to the next.
    """

    def __init__(self, poses: FloatArray, chain: Sequence[MotionEdge]) -> None:
        self._poses = poses
        informations = np.array([edge.information for edge in chain]).reshape(-1, 3, 3)
        carried = _adjoints(poses[1:]) @ np.linalg.inv(informations) @ np.swapaxes(_adjoints(poses[1:]), 1, 2)
        self._sums = np.zeros((len(poses), 3, 3))
        np.cumsum(carried, axis=0, out=self._sums[1:])

    def deviations(
        self, sources: npt.NDArray[np.int64], targets: npt.NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the deviations of position (N,) [m], along its worst direction, and heading (N,) [rad].

        They are those of targets as seen from sources, with nothing but the motions between them (first order; Sola et
        al., eq. 54).
        """
        sums = self._sums[np.maximum(sources, targets)] - self._sums[np.minimum(sources, targets)]
        to_target = _adjoints(inverse(self._poses[targets]))
        covariances = to_target @ sums @ np.swapaxes(to_target, 1, 2)
        xx, yy, xy = covariances[:, 0, 0], covariances[:, 1, 1], covariances[:, 0, 1]
        largest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
        return np.sqrt(np.maximum(largest, 0.0)), np.sqrt(np.maximum(covariances[:, 2, 2], 0.0))


def _adjoints(poses: FloatArray) -> FloatArray:
    """Return the matrices (N, 3, 3) that carry errors in the frames of poses (N, 3) to that of the map; eq. 159."""
    adjoints = np.zeros((len(poses), 3, 3))
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    adjoints[:, 0, 0], adjoints[:, 0, 1], adjoints[:, 0, 2] = cosine, -sine, poses[:, 1]
    adjoints[:, 1, 0], adjoints[:, 1, 1], adjoints[:, 1, 2] = sine, cosine, -poses[:, 0]
    adjoints[:, 2, 2] = 1.0
    return adjoints
