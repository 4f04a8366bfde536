"""A chain of poses thinned to those that matter, without losing what the others know."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.adjustment.chains import compose_chain
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionEdge


class MotionChain:
    """The motions of a drive from each pose to the next.

    Poses without edges of their own need not be solved for: a chain of motions between two others is one motion whose
    covariance is the sum of theirs, carried to its end (first order; Sola et al., eq. 54).

    Parameters
    ----------
    chain
        Motions between consecutive poses.

    Attributes
    ----------
    covariances
        Of each motion (N, 3, 3), in the frame at its end.
    """

    def __init__(self, chain: Sequence[MotionEdge]) -> None:
        _, self._motions, informations = EdgeArrays.of(chain)
        self.covariances: FloatArray = np.asarray(np.linalg.inv(informations), dtype=np.float64)

    def between(self, nodes: npt.NDArray[np.int64]) -> list[MotionEdge]:
        """Return the motions from each of some poses, given by rising indices (M,), to the next."""
        steps, covariances = compose_chain(self._motions, self.covariances, nodes)
        keys = nodes.tolist()
        return [
            MotionEdge(source, target, SE2(*step), information)
            for source, target, step, information in zip(
                keys[:-1], keys[1:], steps.tolist(), np.linalg.inv(covariances), strict=True
            )
        ]
