"""Composition of chains of motions."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, kernel
from tbmslam.kernels.arrays import cleared


@kernel
def compose_chain(
    motions: FloatArray, covariances: FloatArray, nodes: npt.NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """Return the motions (M - 1, 3) from each node to the next and their covariances (M - 1, 3, 3).

    `nodes` (M,) are rising indices of poses. The motions (N, 3) between consecutive poses have covariances (N, 3, 3) in
    the frame at the end. The covariances between two nodes are transformed to the end and summed (first order; Sola et
    al., eq. 54).
    """
    composed, summed = cleared(np.empty((len(nodes) - 1, 3))), cleared(np.empty((len(nodes) - 1, 3, 3)))
    adjoint, carried = cleared(np.empty((3, 3))), np.empty((3, 3))
    adjoint[2, 2] = 1.0
    for number in range(len(nodes) - 1):
        x, y, theta = 0.0, 0.0, 0.0
        for k in range(nodes[number], nodes[number + 1]):
            # The adjoint of the inverse step; Sola et al., eq. 159.
            dx, dy = motions[k, 0], motions[k, 1]
            cosine, sine = math.cos(motions[k, 2]), math.sin(motions[k, 2])
            adjoint[0, 0], adjoint[0, 1], adjoint[0, 2] = cosine, sine, sine * dx - cosine * dy
            adjoint[1, 0], adjoint[1, 1], adjoint[1, 2] = -sine, cosine, cosine * dx + sine * dy
            # Element by element, since sums of arrays take long to compile.
            for a in range(3):
                for d in range(3):
                    carried[a, d] = 0.0
                    for b in range(3):
                        for c in range(3):
                            carried[a, d] += adjoint[a, b] * summed[number, b, c] * adjoint[d, c]
            for a in range(3):
                for d in range(3):
                    summed[number, a, d] = carried[a, d] + covariances[k, a, d]
            cosine, sine = math.cos(theta), math.sin(theta)
            x, y, theta = x + cosine * dx - sine * dy, y + sine * dx + cosine * dy, theta + motions[k, 2]
        composed[number, 0], composed[number, 1] = x, y
        composed[number, 2] = (theta + math.pi) % (2.0 * math.pi) - math.pi
    return composed, summed
