"""Motion factors, and the solver of pose equations: preconditioned conjugate gradients."""

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.adjustment.motion_systems import Motions
from tbmslam.kernels.adjustment.pose_systems import PoseSystem
from tbmslam.kernels.adjustment.two_levels import CoarseSpace, Preconditioner, conjugate_gradients, preconditioner_of
from tbmslam.optimisation.pose_graph import EdgeArrays

_MOST_STEPS = 1000


class PoseSolver:
    """Solver of the equations of poses (N, 3) up to a relative residual of `precision`.

    The preconditioner `factors` of nearly the same equations converges nearly as fast; without one it is computed.
    """

    def __init__(
        self,
        system: PoseSystem,
        poses: FloatArray,
        coarse: CoarseSpace,
        precision: float,
        factors: Preconditioner | None = None,
    ) -> None:
        self._system, self._coarse, self._precision = system, coarse, precision
        self.factors = preconditioner_of(system, poses, coarse) if factors is None else factors

    def solve(self, gradient: FloatArray) -> FloatArray:
        """Return the changes (N, 3) of the poses whose curvature product is the gradient (N, 3)."""
        return conjugate_gradients(self._system, self.factors, self._coarse, gradient, self._precision, _MOST_STEPS)


_APART = 8  # poses between knots: fewer knots need more iterations, and more knots cost more each
_MOST_KNOTS = 250


def coarse_space_of(ends: Sequence[int]) -> CoarseSpace:
    """Return knots for drives whose poses come one drive after the other.

    `ends` (D + 1,) are the first pose of each drive and the number of poses; each drive has at least one pose.
    """
    apart = max(_APART, -(-ends[-1] // _MOST_KNOTS))
    knots, sides, shares = list[npt.NDArray[np.int64]](), list[npt.NDArray[np.int64]](), list[npt.NDArray[np.float64]]()
    count = 0
    for first, last in itertools.pairwise(ends):
        own = np.round(np.linspace(first, last - 1, -(-(last - 1 - first) // apart) + 1)).astype(np.int64)
        poses = np.arange(first, last)
        before = np.clip(np.searchsorted(own, poses, side="right") - 1, 0, max(len(own) - 2, 0))
        after = np.minimum(before + 1, len(own) - 1)
        share = (poses - own[before]) / np.maximum(own[after] - own[before], 1)
        knots.append(own)
        sides.append(count + np.column_stack((before, after)))
        shares.append(np.column_stack((1.0 - share, share)))
        count += len(own)
    return CoarseSpace(np.concatenate(knots), np.vstack(sides), np.vstack(shares))


def motions_of(
    believed: EdgeArrays,
    doubted: EdgeArrays,
    width: float,
    owners: npt.NDArray[np.int64],
    places: FloatArray,
) -> Motions:
    """Return the motions between viewpoints that are fixed to poses, for `motion_systems.motion_equations`.

    Doubted motions have a Cauchy kernel of a width [standard deviations]. `owners` (K,) is the pose of each viewpoint,
    and `places` (K, 3) the viewpoint in the frame of its pose.
    """
    ends, measured, informations = EdgeArrays.joined([believed, doubted])
    widths = np.repeat([np.inf, width], [len(believed.ends), len(doubted.ends)])
    return Motions(owners[ends], places[ends], measured, informations, widths)
