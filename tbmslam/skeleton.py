"""A chain of poses thinned to those that matter, without losing what the others know."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tbmslam.kernels.chains import compose_chain
from tbmslam.pose_graph import MotionEdge
from tbmslam.se2 import SE2, FloatArray


class Skeleton:
    """Some poses of a drive, joined by the motions composed between them.

    Poses without edges of their own need not be solved for: a chain of motions between two others is one motion whose
    covariance is the sum of theirs, carried to its end (first order; Sola et al., eq. 54). The poses in between move
    rigidly with the one before them.

    Parameters
    ----------
    chain
        Motions between consecutive poses.
    nodes
        Rising indices (M,) of the poses that stay; the first pose is among them.
    poses
        Poses (N, 3) that tell how those in between lie to their node.
    """

    def __init__(self, chain: Sequence[MotionEdge], nodes: npt.NDArray[np.int64], poses: FloatArray) -> None:
        self.nodes = nodes
        self._number = {index: number for number, index in enumerate(nodes.tolist())}
        self.chain = _composed(chain, nodes)
        self._node_of = np.searchsorted(nodes, np.arange(len(poses)), side="right") - 1
        base = poses[nodes][self._node_of]
        cosine, sine = np.cos(base[:, 2]), np.sin(base[:, 2])
        dx, dy = (poses[:, :2] - base[:, :2]).T
        self._offsets = np.column_stack((cosine * dx + sine * dy, cosine * dy - sine * dx, poses[:, 2] - base[:, 2]))

    def on_nodes(self, edges: Sequence[MotionEdge]) -> list[MotionEdge]:
        """Return edges between poses of the drive as edges between nodes; all their ends must be nodes."""
        number = self._number
        return [MotionEdge(number[e.source], number[e.target], e.T_source_target, e.information) for e in edges]

    def spread(self, node_poses: FloatArray) -> FloatArray:
        """Return all poses (N, 3) for the nodes' poses (M, 3)."""
        base = node_poses[self._node_of]
        cosine, sine = np.cos(base[:, 2]), np.sin(base[:, 2])
        x, y, theta = self._offsets.T
        return np.column_stack(
            (
                base[:, 0] + cosine * x - sine * y,
                base[:, 1] + sine * x + cosine * y,
                (base[:, 2] + theta + np.pi) % (2.0 * np.pi) - np.pi,
            )
        )


def _composed(chain: Sequence[MotionEdge], nodes: npt.NDArray[np.int64]) -> list[MotionEdge]:
    """Return the motions from each node to the next."""
    if len(nodes) < 2:
        return []
    motions = np.array([edge.T_source_target for edge in chain])
    covariances = np.linalg.inv(np.array([edge.information for edge in chain]))
    steps, summed = compose_chain(motions, covariances, nodes)
    return [
        MotionEdge(number, number + 1, SE2(*step), information)
        for number, (step, information) in enumerate(zip(steps.tolist(), np.linalg.inv(summed), strict=True))
    ]
