"""The robust pose graph of a drive: the motions between keyframes, and the closures that correct them."""

import math
from collections.abc import Iterable, Sequence
from itertools import compress

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray, IntArray
from tbmslam.loop_closure.sequence_consistency import PlacedBundle
from tbmslam.map.drive import spread_corrections
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionChain, MotionEdge, edge_errors, relative_pose

_SAME_PLACE = 0.005  # [m]
_SAME_HEADING = 0.0015  # [rad]
ROUGHLY = 0.05
"""Relative decrease of the error at which solving ends, for poses from which a search starts."""


class ClosureGraphConfig(FrozenConfig):
    """Noise of the closures, and which of them are false."""

    position_deviation: float = Field(0.02, gt=0, description="accuracy of a closure at best [m]")
    heading_deviation: float = Field(0.004, gt=0, description="accuracy of a closure at best [rad]")
    max_contradiction: float = Field(
        4.0, gt=0, description="deviations from the solution from which a closure is dropped"
    )
    robust_width: float = Field(2.0, gt=0, description="deviations from which a closure loses weight")


class ClosureGraph:
    """The poses of a drive and its closures.

    Parameters
    ----------
    config
        Noise of the closures.
    tracked
        Poses (N, 3) of the laser at every keyframe as tracked.
    chain
        Motions between consecutive keyframes.

    Attributes
    ----------
    poses
        Poses (N, 3) by the closures that were solved for.
    closures
        Closures of the last solution, by keyframe and target.
    """

    def __init__(self, config: ClosureGraphConfig, tracked: FloatArray, chain: MotionChain) -> None:
        self._config = config
        self._tracked = tracked
        self._chain = chain
        self.poses = tracked.copy()
        self.closures: dict[tuple[int, int], MotionEdge] = {}
        self._new: list[PlacedBundle] = []

    def add(self, found: Sequence[PlacedBundle]) -> None:
        """Add closures for the next solution. They replace earlier ones between the same keyframe and target."""
        self._new += found

    def optimise(self, precision: float = 1e-4) -> None:
        """Solve for the poses; poses between two closures follow both."""
        self._add_new()
        if not self.closures:
            self.poses = self._tracked.copy()
            return
        nodes = self._nodes()
        self._solve(self._chain.between(nodes), nodes, precision)

    def pull_together(self) -> None:
        """Solve for the poses with the added closures, whatever their distance from the poses.

        A closure far from the poses has no weight in a robust graph. So new closures are trusted first, and weighted
        like all others after the poses have moved.
        """
        new = [(found.keyframe, found.target) for found in self._new]
        self._add_new()
        nodes = self._nodes()
        trusted = EdgeArrays.of([self.closures[key] for key in new])
        self._solve(EdgeArrays.joined([self._chain.between(nodes), trusted]), nodes, ROUGHLY)
        self.optimise(ROUGHLY)

    def drop_contradictions(self) -> None:
        """Drop the closures that contradict the solution, and optimise again."""
        agree = edge_errors(list(self.closures.values()), self.poses) <= self._config.max_contradiction
        if not agree.all():
            self.closures = dict(compress(self.closures.items(), agree))
            self.optimise()

    def has_met(self, keyframe: int, target: int) -> bool:
        """Return whether a closure is known and the poses agree with it, so that registration would find the same."""
        edge = self.closures.get((keyframe, target))
        if edge is None:
            return False
        error = edge.T_source_target.inverse() @ relative_pose(self.poses, edge.source, edge.target)
        return math.hypot(error.x, error.y) < _SAME_PLACE and abs(error.theta) < _SAME_HEADING

    def correction_m(self, found: PlacedBundle) -> float:
        """Return the distance between the pose of a keyframe by a closure and by the graph [m]."""
        error = found.pose.to(relative_pose(self.poses, found.anchor, found.keyframe))
        return math.hypot(error.x, error.y)

    def covariances(self, placed: Sequence[PlacedBundle]) -> FloatArray:
        """Return the covariances (N, 3, 3) of closures in the keyframes' frames: of fits, and of distorted submaps."""
        config = self._config
        floor = np.diag([config.position_deviation**2, config.position_deviation**2, config.heading_deviation**2])
        curvatures = np.array([found.hessian for found in placed]) + np.eye(3) * 1e-3
        rotations = np.array([SE2(0.0, 0.0, found.pose.theta).matrix() for found in placed])
        covariances: FloatArray = np.swapaxes(rotations, 1, 2) @ (np.linalg.inv(curvatures) + floor) @ rotations
        return covariances

    def _add_new(self) -> None:
        # All at once, since each call of numpy takes longer than a covariance.
        if self._new:
            informations = np.linalg.inv(self.covariances(self._new))
            for found, information in zip(self._new, informations, strict=True):
                edge = MotionEdge(found.anchor, found.keyframe, found.pose, information)
                self.closures[found.keyframe, found.target] = edge
            self._new = []

    def _nodes(self) -> IntArray:
        return nodes_of(self.closures.values())

    def _solve(self, chain: EdgeArrays, nodes: IntArray, precision: float) -> None:
        closures, width = self.closures.values(), self._config.robust_width
        solved = optimise(self.poses, chain, closures, width, nodes, precision)
        self.poses = spread_corrections(self._tracked, nodes, solved)


def nodes_of(closures: Iterable[MotionEdge]) -> IntArray:
    """Return the keyframes that closures join, and the first keyframe."""
    return np.unique([0, *(end for edge in closures for end in (edge.source, edge.target))])
