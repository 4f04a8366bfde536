"""The edges of a pose graph, which are measured motions between poses, and the solver of its equations."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import SE2, FloatArray, IntArray, compose, inverse, log
from tbmslam.kernels.adjustment.chains import compose_chain
from tbmslam.kernels.adjustment.motion_systems import Motions
from tbmslam.kernels.adjustment.pose_systems import PoseSystem
from tbmslam.kernels.adjustment.two_levels import CoarseSpace, Preconditioner, conjugate_gradients, preconditioner_of


@dataclass(frozen=True, eq=False)
class MotionEdge:
    """A measured motion between two poses of the graph."""

    source: int
    target: int
    """Indices of the poses."""
    T_source_target: SE2
    """The target as seen from the source."""
    information: FloatArray
    """Inverse covariance (3, 3) of an error in x, y [m] and theta [rad] in the target's frame."""


class EdgeArrays(NamedTuple):
    """Edges as arrays."""

    ends: IntArray
    """Sources and targets (E, 2)."""
    motions: FloatArray
    """The targets as seen from the sources (E, 3)."""
    informations: FloatArray
    """Inverse covariances (E, 3, 3)."""

    @classmethod
    def of(cls, edges: Sequence[MotionEdge]) -> "EdgeArrays":
        """Return edges as arrays."""
        # From plain numbers one after the other, in half the time of rows.
        flat = itertools.chain.from_iterable
        ends = np.fromiter(flat((edge.source, edge.target) for edge in edges), np.int64, 2 * len(edges))
        motions = np.fromiter(flat(edge.T_source_target for edge in edges), np.float64, 3 * len(edges))
        informations = np.concatenate([np.empty((0, 3)), *(edge.information for edge in edges)])
        return cls(ends.reshape(-1, 2), motions.reshape(-1, 3), informations.reshape(-1, 3, 3))

    @classmethod
    def joined(cls, parts: Sequence["EdgeArrays"]) -> "EdgeArrays":
        """Return the edges of all parts in order; at least one part is needed."""
        ends, motions, informations = zip(*parts, strict=True)
        return cls(np.concatenate(ends), np.concatenate(motions), np.concatenate(informations))


def relative_pose(poses: FloatArray, source: int, target: int) -> SE2:
    """Return one pose of (N, 3) as seen from another."""
    return SE2(*poses[source].tolist()).to(SE2(*poses[target].tolist()))


def edge_errors(edges: Sequence[MotionEdge], poses: FloatArray) -> FloatArray:
    """Return the Mahalanobis distances of edges (E,) from the poses [standard deviations]."""
    ends, measured, information = EdgeArrays.of(edges)
    motions = compose(inverse(poses[ends[:, 0]]), poses[ends[:, 1]])
    errors = log(compose(inverse(measured), motions))
    squares: FloatArray = np.einsum("ei,eij,ej->e", errors, information, errors)
    return np.sqrt(squares)


class MotionChain:
    """The motions of a drive from each pose to the next.

    Poses without other edges need not be solved for. A chain of motions is one motion whose covariance is the sum of
    theirs, transformed to its end (first order; Sola et al., eq. 54).

    `steps` (N, 3) are the motions as seen from the pose before: x [m], y [m], theta [rad]. `informations` (N, 3, 3) are
    their inverse covariances, and `covariances` (N, 3, 3) the covariances, in the frames at their ends.
    """

    def __init__(self, steps: FloatArray, informations: FloatArray) -> None:
        self._steps = steps
        self.covariances: FloatArray = np.asarray(np.linalg.inv(informations), dtype=np.float64)

    @classmethod
    def of(cls, edges: Sequence[MotionEdge]) -> "MotionChain":
        """Return the motions of edges from each pose to the next."""
        _, steps, informations = EdgeArrays.of(edges)
        return cls(steps, informations)

    def between(self, nodes: IntArray) -> EdgeArrays:
        """Return the motions from each of some poses, given by rising indices (M,), to the next."""
        steps, covariances = compose_chain(self._steps, self.covariances, nodes)
        informations: FloatArray = np.asarray(np.linalg.inv(covariances), dtype=np.float64)
        return EdgeArrays(np.column_stack((nodes[:-1], nodes[1:])), steps, informations)


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
