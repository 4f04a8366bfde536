"""Edges between maps and links between groups of maps.

An edge is a pose hypothesis of two maps. A link is the relative pose of two groups, with the evidence from the edges
between their maps and from paths over other groups.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from merging.alignment import Alignment, Covariance, Pair, PoseHypothesis, known_best_at, seen_from
from merging.config.groups import GraphConfig
from tbmslam.geometry.se2 import SE2, FloatArray, compose, wrap_angle

_LEAST_ACCEPTED, _MOST_REFUSED = 0.9, 0.85
"""An accepted alignment counts with at least the first confidence, any other with at most the second."""


class Edge(NamedTuple):
    """A pose hypothesis of a pair of maps."""

    pair: Pair
    hypothesis: PoseHypothesis
    """Pose of the source in the target's frame."""

    @property
    def motion(self) -> SE2:
        """Pose of the source in the target's frame."""
        return self.hypothesis.T_target_source

    @property
    def probability(self) -> float:
        """Probability that it is right, never quite 0 or 1."""
        return 1.0 / (1.0 + math.exp(-self.hypothesis.log_odds))


def edges_of(pair: Pair, found: Alignment, config: GraphConfig) -> list[Edge]:
    """Return the edges of an aligned pair: its best pose, however unlikely, and alternatives above `min_confidence`.

    A refused pose is left out if hardly any wall agrees: nearly empty maps fit everywhere.
    """
    edges = []
    for number, hypothesis in enumerate(found.hypotheses()):
        if hypothesis.accepted:
            confidence = max(hypothesis.confidence, _LEAST_ACCEPTED)
        elif hypothesis.agreed_wall_m < config.min_wall_m or (number and hypothesis.confidence < config.min_confidence):
            continue
        else:
            confidence = min(hypothesis.confidence, _MOST_REFUSED)
        edges.append(Edge(pair, replace(hypothesis, confidence=confidence)))
    return edges


def support_of(probability: FloatArray, coincidence: float) -> FloatArray:
    """Return the log odds that a pose gains from a measurement of the same pose.

    `probability` (N,) is the probability that a measurement is right, and `coincidence` that two wrong poses are equal.
    """
    return np.log1p(probability * (1.0 / coincidence - 1.0))


def is_same_pose(motion: SE2, other: SE2, config: GraphConfig, known: Covariance | None = None) -> bool:
    """Return whether two motions are equal within the tolerances: at one point of the source, and in rotation.

    The point is the best known point by the covariance, or the origin of the source's frame without a covariance. The
    origin may be far away, where a tenth of a degree is metres.
    """
    point = (0.0, 0.0) if known is None else known_best_at(known)
    turned = abs(wrap_angle(other.theta - motion.theta))
    return math.dist(motion.apply(point), other.apply(point)) <= config.same_m and turned <= config.same_rad


class CentroidFrames:
    """The centroids of maps in their frames: the mean of the points that their edges determine best.

    A map without a known covariance keeps its frame.
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


_Indices = npt.NDArray[np.intp]


class GroupLink(NamedTuple):
    """A relative pose of two groups."""

    support: float
    """Log odds that it is right."""
    wall_m: float
    """Length of the walls that agree [m]."""
    first: int
    second: int
    """Indices of the groups."""
    motion: SE2
    """Pose of the second group in the frame of the first."""


class GroupLinks:
    """The best link of every two groups, updated as groups are joined.

    `groups` are the poses of the maps of each group in its frame, and change as groups are joined: a group that became
    part of another is empty.
    """

    def __init__(self, groups: Sequence[dict[str, SE2]], edges: Sequence[Edge], config: GraphConfig) -> None:
        self.groups, self._edges, self._config = groups, edges, config
        self._found: dict[tuple[int, int], GroupLink] = {}
        links = _GroupEdges(groups, edges)
        self._update(links, links.pairs())

    def all(self) -> list[GroupLink]:
        """Return the best link of every two groups whose support suffices."""
        return [self._found[pair] for pair in sorted(self._found)]

    def join(self, link: GroupLink) -> None:
        """Add the second group of a link to the first."""
        self.groups[link.first].update({n: link.motion @ pose for n, pose in self.groups[link.second].items()})
        self.groups[link.second].clear()
        links = _GroupEdges(self.groups, self._edges)
        self._found = {pair: found for pair, found in self._found.items() if link.second not in pair}
        # Only links to the group and links with a path over it change.
        near = {link.first, *links.neighbours(link.first)}
        self._update(links, [pair for pair in links.pairs() if near.issuperset(pair)])

    def _update(self, links: "_GroupEdges", pairs: Sequence[tuple[int, int]]) -> None:
        for pair in pairs:
            best = _best_link(links, *pair, self._config)
            if best is None:
                self._found.pop(pair, None)
            else:
                self._found[pair] = best


class _GroupEdges:
    """Edges between groups, each in both directions, sorted by their groups.

    `motions` (E, 3) are the poses of the second group in the frame of the first, `odds` (E,) their log odds.
    """

    def __init__(self, groups: Sequence[Mapping[str, SE2]], edges: Sequence[Edge]) -> None:
        where = {name: index for index, group in enumerate(groups) for name in group}
        found: dict[tuple[int, int], list[tuple[Edge, SE2]]] = {}
        for edge in edges:
            ends = tuple(where.get(name) for name in edge.pair)
            for first, second in (ends, ends[::-1]):
                if first is not None and second is not None and first != second:
                    motion = _between(groups[first], groups[second], edge)
                    found.setdefault((first, second), []).append((edge, motion))
        links = [link for pair in sorted(found) for link in found[pair]]
        self.hypotheses = [edge.hypothesis for edge, _ in links]
        self.poses = [pose for _, pose in links]
        self.motions = np.array(self.poses, dtype=np.float64).reshape(-1, 3)
        self.odds = np.array([hypothesis.log_odds for hypothesis in self.hypotheses])
        self.probabilities = np.array([edge.probability for edge, _ in links])
        self.accepted = np.array([hypothesis.accepted for hypothesis in self.hypotheses], dtype=bool)
        counts = np.zeros((len(groups), len(groups)), dtype=np.intp)
        for pair, joining in found.items():
            counts[pair] = len(joining)
        self._counts, self._begins = counts, np.cumsum(counts).reshape(counts.shape) - counts

    def pairs(self) -> list[tuple[int, int]]:
        """Return the pairs of groups with an edge between them, the lower index first."""
        return [(int(first), int(second)) for first, second in np.argwhere(np.triu(self._counts))]

    def neighbours(self, group: int) -> list[int]:
        """Return the groups that have an edge to a group."""
        return [int(other) for other in np.flatnonzero(self._counts[group])]

    def between(self, first: int, second: int) -> slice:
        """Return the indices of the edges from one group to another."""
        begin = int(self._begins[first, second])
        return slice(begin, begin + int(self._counts[first, second]))

    def paths(self, first: int, second: int) -> tuple[_Indices, _Indices]:
        """Return the two edges (W,) of every path over a third group, sorted by that group."""
        there, onward = self._counts[first], self._counts[:, second]
        others = np.flatnonzero((there > 0) & (onward > 0))
        halves = np.repeat(others, there[others])  # the groups to which the first edges lead
        each = np.arange(len(halves)) - np.repeat(np.cumsum(there[others]) - there[others], there[others])
        paths = np.repeat(np.arange(len(halves)), onward[halves])
        last = np.arange(len(paths)) - np.repeat(np.cumsum(onward[halves]) - onward[halves], onward[halves])
        return (self._begins[first, halves] + each)[paths], self._begins[halves[paths], second] + last


def _best_link(links: _GroupEdges, first: int, second: int, config: GraphConfig) -> GroupLink | None:
    """Return the link with the largest support between two groups; None if no support suffices."""
    direct = links.between(first, second)
    supports = _supports(links, direct, links.paths(first, second), config)
    possible = [
        GroupLink(support, links.hypotheses[index].agreed_wall_m, first, second, links.poses[index])
        for index, support in enumerate(supports, direct.start)
        if support >= config.min_support
    ]
    return max(possible, key=lambda link: link[:2]) if possible else None


def _supports(links: _GroupEdges, direct: slice, paths: tuple[_Indices, _Indices], config: GraphConfig) -> list[float]:
    """Return the log odds of the pose of each direct edge: its evidence, less accepted edges and paths to others.

    Maps of one place are not independent: a perceptual alias of one is an alias of all. So a further edge or path to
    the same pose adds little, and less the less probable it is. Refused edges may all have one cause; together they
    never add more than one certain edge.
    """
    there, onward = paths
    poses, odds = links.motions[direct], links.odds[direct]
    # A path is right if both of its edges are.
    path_odds = np.minimum(links.odds[there], links.odds[onward]) - math.log(2.0)
    same = _are_same(poses, poses, config)
    same_path = _are_same(poses, compose(links.motions[there], links.motions[onward]), config)
    also = np.concatenate((links.probabilities[direct], links.probabilities[there] * links.probabilities[onward]))
    support, at_most = support_of(also, config.coincidence), -math.log(config.coincidence)
    accepted, likely_paths = links.accepted[direct], path_odds > 0.0
    sure = np.concatenate((accepted, links.accepted[there] & links.accepted[onward]))
    supports = []
    for row, row_paths in zip(same, same_path, strict=True):
        best = np.flatnonzero(row)[odds[row].argmax()]
        leading = np.concatenate((row, row_paths))
        leading[best] = False
        further = support[leading & sure].sum() + min(support[leading & ~sure].sum(), at_most)
        contrary = odds[~row & accepted].sum() + path_odds[~row_paths & likely_paths].sum()
        supports.append(float(odds[best] + further - contrary))
    return supports


def _are_same(poses: FloatArray, others: FloatArray, config: GraphConfig) -> npt.NDArray[np.bool_]:
    """Return which other poses (W, 3) equal each of the poses (D, 3), as an array (D, W); see `is_same_pose`."""
    x, y, turn = (others[:, axis] - poses[:, axis, None] for axis in range(3))
    turned = np.abs(turn)  # of two angles in [-pi, pi), less than a whole turn
    alike = (turned <= config.same_rad) | (turned >= 2.0 * math.pi - config.same_rad)
    return np.asarray(alike & (x * x + y * y <= config.same_m**2))


def _between(first: Mapping[str, SE2], second: Mapping[str, SE2], edge: Edge) -> SE2:
    """Return the pose of the second group in the frame of the first, by an edge between two of their maps."""
    target, source = edge.pair
    if target in first:
        return first[target] @ edge.motion @ second[source].inverse()
    return first[source] @ edge.motion.inverse() @ second[target].inverse()
