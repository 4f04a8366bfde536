"""Edges of the map graph: the pose hypotheses of pairs of maps, and the frames in which they are compared."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from merging.alignment import Alignment, Pair, PoseHypothesis
from merging.config.groups import GraphConfig
from merging.verification.covariance import Covariance, known_best_at, seen_from
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle

_ACCEPTED, _REFUSED = 0.9, 0.85
"""Least confidence of an accepted alignment, and largest of a refused one or of an alternative."""


class Edge(NamedTuple):
    """A pose hypothesis of a pair of maps.

    Parameters
    ----------
    pair
        The target and the source.
    hypothesis
        Pose of the source in the target's frame.
    """

    pair: Pair
    hypothesis: PoseHypothesis

    @property
    def motion(self) -> SE2:
        """Pose of the source in the target's frame."""
        return self.hypothesis.T_target_source

    @property
    def probability(self) -> float:
        """Probability that it is right, never quite 0 or 1."""
        return 1.0 / (1.0 + math.exp(-self.hypothesis.log_odds))


def edges_of(pair: Pair, found: Alignment, config: GraphConfig) -> list[Edge]:
    """Return the edges of an aligned pair: its best pose, however unlikely, and likely alternatives.

    A refused pose is left out if hardly any wall agrees: nearly empty maps fit everywhere.
    """
    edges = []
    for number, hypothesis in enumerate(found.hypotheses()):
        if hypothesis.accepted:
            confidence = max(hypothesis.confidence, _ACCEPTED)
        elif hypothesis.agreed_wall_m < config.min_wall_m or (number and hypothesis.confidence < config.min_confidence):
            continue
        else:
            confidence = min(hypothesis.confidence, _REFUSED)
        edges.append(Edge(pair, replace(hypothesis, confidence=confidence)))
    return edges


def support_of(probability: FloatArray, coincidence: float) -> FloatArray:
    """Return the log odds that a pose gains from a further measurement that leads to the same pose.

    Parameters
    ----------
    probability
        Probability (N,) that the measurement is right; then it leads there for sure.
    coincidence
        Probability that it leads there if both it and the pose are wrong.
    """
    return np.log1p(probability * (1.0 / coincidence - 1.0))


def is_same_pose(motion: SE2, other: SE2, config: GraphConfig, known: Covariance | None = None) -> bool:
    """Return whether two motions are equal within the tolerances: at one point of the source, and in rotation.

    The point is the one that the covariance knows best, or the origin of the source's frame without a covariance. The
    origin may be far away, where a tenth of a degree is metres.
    """
    point = (0.0, 0.0) if known is None else known_best_at(known)
    turned = abs(wrap_angle(other.theta - motion.theta))
    return math.dist(motion.apply(point), other.apply(point)) <= config.same_m and turned <= config.same_rad


class CentroidFrames:
    """The centroids of maps in their frames: the mean of the points that their alignments know best.

    Parameters
    ----------
    edges
        Edges between the frames of the maps. A map without a known covariance keeps its frame.
    """

    def __init__(self, edges: Sequence[Edge]) -> None:
        known: dict[str, list[tuple[float, float]]] = {}
        for (target, source), hypothesis in edges:
            if hypothesis.covariance is not None:
                point = known_best_at(hypothesis.covariance)
                x, y = hypothesis.T_target_source.apply(point)
                known.setdefault(target, []).append((float(x), float(y)))
                known.setdefault(source, []).append(point)
        centroids = {name: np.mean(points, axis=0) for name, points in known.items()}
        self._centroids = {name: SE2(float(x), float(y), 0.0) for name, (x, y) in centroids.items()}

    def of(self, name: str) -> SE2:
        """Return the pose of a map's centroid in its frame, T_map_centroid."""
        return self._centroids.get(name, SE2.identity())

    def between(self, edge: Edge) -> Edge:
        """Return the same edge between the centroids of its maps."""
        target, source = (self.of(name) for name in edge.pair)
        covariance = edge.hypothesis.covariance
        hypothesis = replace(
            edge.hypothesis,
            T_target_source=target.inverse() @ edge.motion @ source,
            covariance=None if covariance is None else seen_from(covariance, source.inverse()),
        )
        return Edge(edge.pair, hypothesis)

    def group(self, poses: Mapping[str, SE2]) -> dict[str, SE2]:
        """Return the poses of the centroids of a group's maps in the frame of the first centroid."""
        centroids = {name: pose @ self.of(name) for name, pose in poses.items()}
        T_first_group = next(iter(centroids.values())).inverse()
        return {name: T_first_group @ pose for name, pose in centroids.items()}

    def maps(self, poses: Mapping[str, SE2]) -> dict[str, SE2]:
        """Return the poses of a group's maps in the frame of the first map, from the poses of their centroids."""
        maps = {name: pose @ self.of(name).inverse() for name, pose in poses.items()}
        T_first_group = next(iter(maps.values())).inverse()
        return {name: T_first_group @ pose for name, pose in maps.items()}
