"""Many maps: which belong together, and where each lies.

Every pair of maps offers places: the one found, and its alternatives. Two maps, and then groups of maps, are joined
where all that speaks for one place outweighs what speaks against it: the pairs' own alignments, and the ways over a
third map that lead to the same place. So wrong alignments are outvoted, and ambiguous ones decided, where others know
better.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config.groups import GraphConfig
from merging.map_graph.hypothesis import CentroidFrames, PoseHypothesis, hypotheses_of, is_same_place
from merging.map_graph.links import GroupLinks
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import MotionEdge


@dataclass(frozen=True)
class Group:
    """Maps that belong together.

    Parameters
    ----------
    poses
        T_group_map of every map in it; the group's frame is that of its first map.
    used
        The pairs whose alignment, found or alternative, agrees with these poses.
    outvoted
        The pairs that were accepted and do not.
    """

    poses: Mapping[str, SE2]
    used: tuple[Pair, ...] = ()
    outvoted: tuple[Pair, ...] = ()

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self.poses)

    @property
    def first(self) -> str:
        """The map whose frame the group has."""
        return next(iter(self.poses))


def groups_of(
    names: Sequence[str],
    alignments: Mapping[Pair, Alignment],
    config: GraphConfig | None = None,
    known: Mapping[str, SE2] | None = None,
) -> list[Group]:
    """Join maps to groups and find their poses.

    Parameters
    ----------
    names
        The maps, in the order that decides whose frame a group has.
    alignments
        Alignments of pairs (target, source); refused ones may still confirm others.
    config
        When places are one, and what a confirmation is worth.
    known
        Poses of maps that are a group whatever speaks against it.

    Returns
    -------
    The groups, the known one before all, the largest first, and among equals the one whose first map was named first;
    a map that nothing connects is a group of its own.
    """
    config, known = config or GraphConfig(), known or {}
    centroids, offers = _between_centroids(alignments, config)
    trusted = _without_outvoted(offers, config)
    groups = [centroids.group(known)[1]] if known else []
    groups += [{name: SE2.identity()} for name in names if name not in known]
    links = GroupLinks(groups, trusted, config)
    while found := links.all():
        links.join(max(found, key=lambda link: link[:2]))
    ordered = [{name: group[name] for name in names if name in group} for group in groups if group]
    finished = [_finished(group, offers, centroids, config) for group in ordered]
    return sorted(
        finished, key=lambda group: (known.keys().isdisjoint(group.poses), -len(group), list(names).index(group.first))
    )


def _between_centroids(
    alignments: Mapping[Pair, Alignment], config: GraphConfig
) -> tuple[CentroidFrames, list[PoseHypothesis]]:
    """Return the centroids of maps, and where alignments put one in the frame of another."""
    offers = [offer for pair, found in alignments.items() for offer in hypotheses_of(pair, found, config)]
    centroids = CentroidFrames(offers)
    return centroids, [centroids.between(offer) for offer in offers]


def _without_outvoted(offers: list[PoseHypothesis], config: GraphConfig) -> list[PoseHypothesis]:
    """Drop accepted alignments that stand against most cycles they are in, the worst first.

    Of three that contradict one another any may be the wrong one; then all stay, and weigh against each other.
    """
    kept = list(offers)
    while True:
        accepted = [offer for offer in kept if offer.accepted]
        balances = dict.fromkeys((offer.pair for offer in accepted), 0)
        for cycle in _triangles(accepted):
            vote = 1 if is_same_place(_round_trip(cycle), SE2.identity(), config) else -1
            for offer in cycle:
                balances[offer.pair] += vote
        worst = min(balances.values(), default=0)
        pairs = [pair for pair, balance in balances.items() if balance == worst]
        if worst >= 0 or len(pairs) > 1:
            return kept
        kept = [offer for offer in kept if not (offer.accepted and offer.pair == pairs[0])]


def _triangles(accepted: Sequence[PoseHypothesis]) -> Iterator[tuple[PoseHypothesis, PoseHypothesis, PoseHypothesis]]:
    """Yield the alignments, in their order, of any three maps of which each is aligned with both others."""
    # Of all threes of alignments hardly any close a triangle: of twenty maps one in a thousand.
    joining: dict[str, dict[str, int]] = {}
    for index, offer in enumerate(accepted):
        for name, other in (offer.pair, offer.pair[::-1]):
            joining.setdefault(name, {})[other] = index
    for first, offer in enumerate(accepted):
        here, there = (joining[name] for name in offer.pair)
        for third_map in here.keys() & there.keys():
            second, third = sorted((here[third_map], there[third_map]))
            if first < second:
                yield offer, accepted[second], accepted[third]


def _round_trip(cycle: tuple[PoseHypothesis, PoseHypothesis, PoseHypothesis]) -> SE2:
    """Return the motion once around three alignments that close a triangle."""
    here, motion, left = cycle[0].pair[1], cycle[0].motion, list(cycle[1:])
    while left:
        onward = next(offer for offer in left if here in offer.pair)
        left.remove(onward)
        target, source = onward.pair
        motion = motion @ (onward.motion if here == target else onward.motion.inverse())
        here = source if here == target else target
    return motion


def _finished(
    poses: dict[str, SE2], offers: list[PoseHypothesis], centroids: CentroidFrames, config: GraphConfig
) -> Group:
    """Refine the centroids' poses by all alignments that agree with them; return the maps'."""
    names = list(poses)
    inside = [offer for offer in offers if offer.pair[0] in poses and offer.pair[1] in poses]
    agreeing = [
        offer
        for offer in inside
        if is_same_place(poses[offer.pair[0]].inverse() @ poses[offer.pair[1]], offer.motion, config)
    ]
    used = dict.fromkeys(offer.pair for offer in agreeing)
    outvoted = tuple(dict.fromkeys(o.pair for o in inside if o.accepted and o.pair not in used))
    exact = dict(poses)
    if len(agreeing) >= len(names):  # a tree has nothing to balance
        edges = [
            MotionEdge(names.index(o.pair[0]), names.index(o.pair[1]), o.motion, _information(o, config))
            for o in agreeing
        ]
        solved = optimise(np.array([exact[name] for name in names]), [], edges, config.robust_width)
        exact = {name: SE2.from_array(pose) for name, pose in zip(names, solved, strict=True)}
    return Group({**centroids.maps(exact), names[0]: SE2.identity()}, tuple(used), outvoted)


def _information(offer: PoseHypothesis, config: GraphConfig) -> FloatArray:
    """Return how exact an alignment is, as far as it is right: one that hardly can be has hardly a say."""
    stated = np.diag([config.deviation_m**2, config.deviation_m**2, config.deviation_rad**2])
    covariance = stated if offer.covariance is None else np.array(offer.covariance)
    return np.asarray(offer.probability * np.linalg.inv(covariance))
