"""Many maps: which belong together, and where each lies.

Every pair of maps offers places: the one found, and its alternatives. Two maps, and then groups of maps, are joined
where all that speaks for one place outweighs what speaks against it: the pairs' own alignments, and the ways over a
third map that lead to the same place. So wrong alignments are outvoted, and ambiguous ones decided, where others know
better.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config import GraphConfig
from tbmslam.pose_graph import MotionEdge, optimise
from tbmslam.se2 import SE2, FloatArray, wrap_angle

_SURE, _DOUBTFUL = 0.999, 0.85
"""No alignment is believed more than this, and none that was refused."""


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


@dataclass(frozen=True)
class Offer:
    """A place that a pair of maps offers.

    Parameters
    ----------
    pair
        The target and the source.
    motion
        T_target_source.
    odds
        Log odds that it is right.
    wall_m
        Agreeing wall [m].
    accepted
        Whether the alignment was.
    """

    pair: Pair
    motion: SE2
    odds: float
    wall_m: float
    accepted: bool


def groups_of(
    names: Sequence[str], alignments: Mapping[Pair, Alignment], config: GraphConfig | None = None
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

    Returns
    -------
    The groups, the largest first, and among equals the one whose first map was named first; a map that nothing
    connects is a group of its own.
    """
    config = config or GraphConfig()
    offers = [offer for pair, found in alignments.items() for offer in offers_of(pair, found, config)]
    trusted = _without_outvoted(offers, config)
    groups = [{name: SE2.identity()} for name in names]
    while True:
        between = _by_groups(groups, trusted)
        joints = [
            joint
            for first, second in itertools.combinations(range(len(groups)), 2)
            if (joint := _best_joint(groups, first, second, between, config)) is not None
        ]
        if not joints:
            break
        _, _, first, second, motion = max(joints, key=lambda joint: joint[:2])
        groups[first] |= {name: motion @ pose for name, pose in groups[second].items()}
        del groups[second]
    ordered = [{name: group[name] for name in names if name in group} for group in groups]
    finished = [_finished(group, offers, config) for group in ordered]
    return sorted(finished, key=lambda group: (-len(group), list(names).index(group.first)))


def join(
    first: Mapping[str, SE2], second: Mapping[str, SE2], alignments: Mapping[Pair, Alignment], config: GraphConfig
) -> tuple[SE2, float] | None:
    """Return where a group of maps lies in another's frame, and the log odds of it; None if too little speaks for it.

    Parameters
    ----------
    first, second
        T_group_map of every map of each group.
    alignments
        Alignments of pairs of maps of different groups.
    config
        When places are one, and what a confirmation is worth.
    """
    offers = [offer for pair, found in alignments.items() for offer in offers_of(pair, found, config)]
    groups = [dict(first), dict(second)]
    joint = _best_joint(groups, 0, 1, _by_groups(groups, offers), config)
    return None if joint is None else (joint[4], joint[0])


def offers_of(pair: Pair, found: Alignment, config: GraphConfig) -> list[Offer]:
    """Return the places that an alignment of a pair offers: its best, however unlikely, and likely alternatives."""
    if found.T_target_source is None:
        return []
    confidence = max(found.confidence, 0.9) if found.accepted else found.confidence
    places = [(found.T_target_source, confidence, found.agreed_wall_m, found.accepted)]
    likely = (one for one in found.alternatives if one.confidence >= config.min_confidence)
    places += [(one.T_target_source, one.confidence, one.agreed_wall_m, False) for one in likely]
    return [
        Offer(pair, motion, _log_odds(confidence if accepted else min(confidence, _DOUBTFUL)), wall_m, accepted)
        for motion, confidence, wall_m, accepted in places
    ]


def _log_odds(confidence: float) -> float:
    p = min(max(confidence, 1.0 - _SURE), _SURE)
    return math.log(p / (1.0 - p))


def _without_outvoted(offers: list[Offer], config: GraphConfig) -> list[Offer]:
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


def _triangles(accepted: Sequence[Offer]) -> Iterator[tuple[Offer, Offer, Offer]]:
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


def _round_trip(cycle: tuple[Offer, Offer, Offer]) -> SE2:
    """Return the motion once around three alignments that close a triangle."""
    here, motion, left = cycle[0].pair[1], cycle[0].motion, list(cycle[1:])
    while left:
        onward = next(offer for offer in left if here in offer.pair)
        left.remove(onward)
        target, source = onward.pair
        motion = motion @ (onward.motion if here == target else onward.motion.inverse())
        here = source if here == target else target
    return motion


_Joint = tuple[float, float, int, int, SE2]
"""Support, metres of wall, the indices of two groups, and where the second lies in the first's frame."""


_Between = Mapping[tuple[int, int], Sequence[tuple[Offer, SE2]]]
"""By the indices of two groups, the offers that join them, and where each puts the second in the first's frame."""


def _by_groups(groups: list[dict[str, SE2]], offers: list[Offer]) -> _Between:
    """Sort offers by the groups that they join, either way round."""
    where = {name: index for index, group in enumerate(groups) for name in group}
    between: dict[tuple[int, int], list[tuple[Offer, SE2]]] = {}
    for offer in offers:
        ends = tuple(where.get(name) for name in offer.pair)
        for first, second in (ends, ends[::-1]):
            if first is not None and second is not None and first != second:
                motion = _between(groups[first], groups[second], offer)
                between.setdefault((first, second), []).append((offer, motion))
    return between


def _best_joint(
    groups: list[dict[str, SE2]], first: int, second: int, between: _Between, config: GraphConfig
) -> _Joint | None:
    """Return the place of the second group in the first's frame for which most speaks; None if too little does."""
    direct = between.get((first, second), ())
    if not direct:
        return None
    others = [index for index in range(len(groups)) if index not in {first, second}]
    ways = [way for other in others for way in _ways_over(first, other, second, between)]
    joints = [(_support(motion, direct, ways, config), offer.wall_m, first, second, motion) for offer, motion in direct]
    good = [joint for joint in joints if joint[0] >= config.min_support]
    return max(good, key=lambda joint: joint[:2]) if good else None


def _support(
    place: SE2, direct: Sequence[tuple[Offer, SE2]], ways: list[tuple[float, SE2]], config: GraphConfig
) -> float:
    """Return the log odds of a place: what leads to it, less what was accepted and leads elsewhere.

    One doubtful alignment stays doubtful, but chance seldom leads to one place twice: each further one adds at least
    the worth of a confirmation.
    """
    leading = sorted((offer.odds for offer, there in direct if is_same_place(place, there, config)), reverse=True)
    leading[1:] += [odds for odds, there in ways if is_same_place(place, there, config)]
    against = [offer.odds for offer, there in direct if offer.accepted and not is_same_place(place, there, config)]
    against += [odds for odds, there in ways if odds > 0.0 and not is_same_place(place, there, config)]
    return leading[0] + sum(max(odds, config.confirmation) for odds in leading[1:]) - sum(against)


def _between(first: dict[str, SE2], second: dict[str, SE2], offer: Offer) -> SE2:
    """Return where an offer that joins two groups puts the second in the first's frame."""
    target, source = offer.pair
    if target in first:
        return first[target] @ offer.motion @ second[source].inverse()
    return first[source] @ offer.motion.inverse() @ second[target].inverse()


def _ways_over(first: int, middle: int, second: int, between: _Between) -> list[tuple[float, SE2]]:
    """Return the log odds of every way over a third group, and where it leads."""
    there, onward = between.get((first, middle), ()), between.get((middle, second), ())
    # A way is right where both of its halves are.
    return [(min(a.odds, b.odds) - math.log(2.0), p @ q) for (a, p), (b, q) in itertools.product(there, onward)]


def is_same_place(motion: SE2, other: SE2, config: GraphConfig) -> bool:
    """Tell whether two motions name one place."""
    apart = motion.inverse() @ other
    return math.hypot(apart.x, apart.y) <= config.same_m and abs(wrap_angle(apart.theta)) <= config.same_rad


def _finished(poses: dict[str, SE2], offers: list[Offer], config: GraphConfig) -> Group:
    """Let all alignments that agree with the poses make them exact, in the first map's frame."""
    names = list(poses)
    inside = [offer for offer in offers if offer.pair[0] in poses and offer.pair[1] in poses]
    agreeing = [
        offer
        for offer in inside
        if is_same_place(poses[offer.pair[0]].inverse() @ poses[offer.pair[1]], offer.motion, config)
    ]
    used = dict.fromkeys(offer.pair for offer in agreeing)
    outvoted = tuple(dict.fromkeys(o.pair for o in inside if o.accepted and o.pair not in used))
    start = poses[names[0]].inverse()
    exact = {name: start @ pose for name, pose in poses.items()}
    if len(agreeing) >= len(names):  # a tree has nothing to balance
        edges = [
            MotionEdge(names.index(o.pair[0]), names.index(o.pair[1]), o.motion, _information(o, config))
            for o in agreeing
        ]
        solved = optimise(np.array([exact[name] for name in names]), [], edges, config.robust_width)
        exact = {name: SE2.from_array(pose) for name, pose in zip(names, solved, strict=True)}
        exact[names[0]] = SE2.identity()
    return Group(exact, tuple(used), outvoted)


def _information(offer: Offer, config: GraphConfig) -> FloatArray:
    """Return how exact an alignment is: the more wall, the more."""
    more = max(offer.wall_m, 1.0) / 10.0
    return more * np.diag([config.deviation_m**-2, config.deviation_m**-2, config.deviation_rad**-2])
