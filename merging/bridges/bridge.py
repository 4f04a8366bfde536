"""Bridges of the map graph: one or two alignments that alone join two sides of a group.

Two alignments between the same sides are not independent evidence, since the maps of a side show the same rooms. So
they are a bridge as well if each side has several maps. Without this rule, two of 30 simulated buildings were joined in
two of three sets of 300 maps. Refused alignments that agree are a bridge, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.map_graph.grouping import Group
from tbmslam.geometry.se2 import SE2

Sides = frozenset[frozenset[str]]
"""The maps on either side of a bridge."""
TOO_WEAK_TO_JOIN = 0.3
"""Refused alignments up to this confidence join no groups: together they give log odds of 0.1 at most, and a link
needs 2.19 (`GraphConfig.min_support`)."""


@dataclass(frozen=True)
class Bridge:
    """The most certain alignment between two sides of a group, with the other accepted one if there is one."""

    pairs: tuple[Pair, ...]
    """The pair (target, source) of the alignment, and that of the other one if there is one."""
    sides: tuple[Mapping[str, SE2], Mapping[str, SE2]]
    """The poses of the maps on the target's side and on the source's, in the group's frame."""

    @property
    def pair(self) -> Pair:
        """The pair of the alignment."""
        return self.pairs[0]

    @property
    def names(self) -> Sides:
        """The maps on either side."""
        return frozenset(map(frozenset, self.sides))


def bridges_of(group: Group, alignments: Mapping[Pair, Alignment], config: MergeConfig) -> list[Bridge]:
    """Return the bridges of a group of more than two maps: the most certain alignment for each pair of sides."""
    bridges = dict[Sides, Bridge]()
    accepted = [pair for pair in group.used if alignments[pair].accepted]
    for pair in sorted(group.used, key=lambda pair: _certainty(alignments[pair]), reverse=True):
        found = alignments[pair]
        is_too_weak = not found.accepted and found.confidence <= TOO_WEAK_TO_JOIN
        if found.method != "correlation" or is_too_weak or len(group) <= 2:
            continue
        for removed in ([pair], *([pair, second] for second in _seconds(pair, accepted, alignments))):
            sides = _sides_without(removed, group, alignments, config)
            if sides is None or frozenset(sides) in bridges:
                continue
            if len(removed) == 1 or min(map(len, sides)) > 1:
                here, there = ({name: pose for name, pose in group.poses.items() if name in side} for side in sides)
                bridges[frozenset(sides)] = Bridge(tuple(removed), (here, there))
    return list(bridges.values())


def _seconds(pair: Pair, accepted: Sequence[Pair], alignments: Mapping[Pair, Alignment]) -> list[Pair]:
    """Return the accepted pairs that may be a bridge together with an accepted pair: those along a path around it."""
    around = _path(pair, accepted) if pair in accepted else []
    return [second for second in around if alignments[second].method == "correlation"]


def _path(ends: Pair, joined: Sequence[Pair]) -> list[Pair]:
    """Return the joined pairs along a shortest path between two maps, other than their own; none without a path."""
    reached, waiting = dict[str, list[Pair]]({ends[0]: []}), [ends[0]]
    for name in waiting:
        for pair in joined:
            if name not in pair or pair == ends:
                continue
            other = pair[0] if pair[1] == name else pair[1]
            if other not in reached:
                reached[other] = [*reached[name], pair]
                waiting.append(other)
        if ends[1] in reached:
            break
    return reached.get(ends[1], [])


def _certainty(found: Alignment) -> tuple[bool, float]:
    return found.accepted, found.confidence


def _sides_without(
    removed: Sequence[Pair], group: Group, alignments: Mapping[Pair, Alignment], config: MergeConfig
) -> tuple[frozenset[str], frozenset[str]] | None:
    """Return the maps on the sides of the first removed pair; None if other accepted alignments join the sides.

    Refused alignments that agree with the group's poses also assign maps to a side, in order of certainty, but do not
    join sides. A map without such an alignment is on no side.
    """
    pair, others = removed[0], [other for other in group.used if other not in removed]
    surest_first = sorted(others, key=lambda other: _certainty(alignments[other]), reverse=True)
    # A map with a known pose that its walls do not confirm is no evidence for other maps at its place.
    unconfirmed = {
        other
        for other in others
        if alignments[other].method == "prior" and alignments[other].confidence < config.verification.min_confidence
    }
    if unconfirmed and _sides(pair, group, alignments, surest_first) is None:
        return None
    return _sides(pair, group, alignments, [other for other in surest_first if other not in unconfirmed])


def _sides(
    pair: Pair, group: Group, alignments: Mapping[Pair, Alignment], surest_first: Sequence[Pair]
) -> tuple[frozenset[str], frozenset[str]] | None:
    """Return the maps that alignments assign to either side of a pair; None if accepted ones join the sides."""
    sides = {name: frozenset({name}) for name in group.poses}
    for target, source in surest_first:
        joined = sides[target] | sides[source]
        if joined.issuperset(pair):
            if alignments[target, source].accepted:
                return None
            continue
        sides |= dict.fromkeys(joined, joined)
    return sides[pair[0]], sides[pair[1]]
