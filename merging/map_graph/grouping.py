"""Groups of maps that belong together, and the poses of the maps in them.

Each aligned pair gives pose hypotheses: the pose of its alignment and its alternatives. Two maps, and then two groups,
are joined at a relative pose if the evidence for it outweighs the evidence against it. The evidence consists of the
alignments of the pairs, and of paths over a third map that lead to the same pose. So other pairs outvote wrong
alignments and decide ambiguous ones.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config.groups import GraphConfig
from merging.map_graph.links import CentroidFrames, Edge, GroupLinks, edges_of, is_same_pose
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionEdge


@dataclass(frozen=True)
class Group:
    """Maps that belong together."""

    poses: Mapping[str, SE2]
    """T_group_map of every map in it; the frame of the group is the frame of its first map."""
    used: tuple[Pair, ...] = ()
    """The pairs whose alignment, or an alternative of it, agrees with these poses."""
    outvoted: tuple[Pair, ...] = ()
    """The accepted pairs that do not agree with them."""

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self.poses)

    @property
    def first(self) -> str:
        """The map whose frame is the group's frame."""
        return next(iter(self.poses))


def groups_of(
    names: Sequence[str],
    alignments: Mapping[Pair, Alignment],
    config: GraphConfig | None = None,
    known: Mapping[str, SE2] | None = None,
) -> list[Group]:
    """Join maps to groups and estimate their poses; a group has the frame of its first map in the order of `names`.

    Refused alignments of pairs (target, source) may confirm others. The maps in `known` form a group regardless of the
    evidence. The groups are ordered: the known one first, then by size, then by the order of their first maps. A map
    without a link is a group of its own.
    """
    config, known = config or GraphConfig(), known or {}
    centroids, edges = _between_centroids(alignments, config)
    groups = [centroids.group(known)] if known else []
    groups += [{name: SE2.identity()} for name in names if name not in known]
    links = GroupLinks(groups, _without_outvoted(edges, config), config)
    while found := links.all():
        links.join(max(found, key=lambda link: link[:2]))
    ordered = [{name: group[name] for name in names if name in group} for group in groups if group]
    finished = [_finished(group, edges, centroids, config) for group in ordered]
    return sorted(
        finished, key=lambda group: (known.keys().isdisjoint(group.poses), -len(group), list(names).index(group.first))
    )


def _between_centroids(alignments: Mapping[Pair, Alignment], config: GraphConfig) -> tuple[CentroidFrames, list[Edge]]:
    """Return the centroids of the maps, and the edges between them."""
    edges = [edge for pair, found in alignments.items() for edge in edges_of(pair, found, config)]
    centroids = CentroidFrames(edges)
    return centroids, [centroids.between(edge) for edge in edges]


def _without_outvoted(edges: list[Edge], config: GraphConfig) -> list[Edge]:
    """Drop accepted alignments that contradict most of their cycles, the worst first.

    If two alignments are equally bad, all stay: in a cycle of three that does not close, any may be the wrong one.
    """
    kept = list(edges)
    while True:
        accepted = [edge for edge in kept if edge.hypothesis.accepted]
        balances = dict.fromkeys((edge.pair for edge in accepted), 0)
        for cycle in _triangles(accepted):
            vote = 1 if is_same_pose(_round_trip(cycle), SE2.identity(), config) else -1
            for edge in cycle:
                balances[edge.pair] += vote
        worst = min(balances.values(), default=0)
        pairs = [pair for pair, balance in balances.items() if balance == worst]
        if worst >= 0 or len(pairs) > 1:
            return kept
        kept = [edge for edge in kept if not (edge.hypothesis.accepted and edge.pair == pairs[0])]


def _triangles(accepted: Sequence[Edge]) -> Iterator[tuple[Edge, Edge, Edge]]:
    """Yield the edges, in their order, of any three maps that are all aligned with each other."""
    # Few triples of edges form a triangle: with twenty maps one in a thousand.
    joining: dict[str, dict[str, int]] = {}
    for index, edge in enumerate(accepted):
        for name, other in (edge.pair, edge.pair[::-1]):
            joining.setdefault(name, {})[other] = index
    for first, edge in enumerate(accepted):
        here, there = (joining[name] for name in edge.pair)
        for third_map in here.keys() & there.keys():
            second, third = sorted((here[third_map], there[third_map]))
            if first < second:
                yield edge, accepted[second], accepted[third]


def _round_trip(cycle: tuple[Edge, Edge, Edge]) -> SE2:
    """Return the motion around a triangle of edges."""
    here, motion, left = cycle[0].pair[1], cycle[0].motion, list(cycle[1:])
    while left:
        onward = next(edge for edge in left if here in edge.pair)
        left.remove(onward)
        target, source = onward.pair
        motion = motion @ (onward.motion if here == target else onward.motion.inverse())
        here = source if here == target else target
    return motion


def _finished(poses: dict[str, SE2], edges: list[Edge], centroids: CentroidFrames, config: GraphConfig) -> Group:
    """Optimise the centroids of a group by all edges that agree with them, and return the poses of the maps."""
    names = list(poses)
    inside = [edge for edge in edges if edge.pair[0] in poses and edge.pair[1] in poses]
    agreeing = [
        edge
        for edge in inside
        if is_same_pose(poses[edge.pair[0]].inverse() @ poses[edge.pair[1]], edge.motion, config)
    ]
    used = dict.fromkeys(edge.pair for edge in agreeing)
    outvoted = tuple(dict.fromkeys(e.pair for e in inside if e.hypothesis.accepted and e.pair not in used))
    exact = dict(poses)
    if len(agreeing) >= len(names):  # a tree has nothing to balance
        motions = [
            MotionEdge(names.index(e.pair[0]), names.index(e.pair[1]), e.motion, _information(e, config))
            for e in agreeing
        ]
        solved = optimise(np.array([exact[name] for name in names]), EdgeArrays.of([]), motions, config.robust_width)
        exact = {name: SE2.from_array(pose) for name, pose in zip(names, solved, strict=True)}
    return Group({**centroids.maps(exact), names[0]: SE2.identity()}, tuple(used), outvoted)


def _information(edge: Edge, config: GraphConfig) -> FloatArray:
    """Return the information (3, 3) of an edge, weighted by its probability."""
    stated = np.diag([config.deviation_m**2, config.deviation_m**2, config.deviation_rad**2])
    covariance = stated if edge.hypothesis.covariance is None else np.array(edge.hypothesis.covariance)
    return np.asarray(edge.probability * np.linalg.inv(covariance))
