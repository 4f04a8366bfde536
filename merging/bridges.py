"""Bridges of the map graph: one or two alignments that join two groups, and their verification.

A few walls of two maps may agree by chance. If two buildings have similar rooms, several refused alignments agree with
a wrong pose. So each bridge is verified by an alignment of both groups, each as one map of all its walls. A confident
bridge is verified too: of the 45,000 pairs of 300 maps, six of different buildings were accepted, one with a confidence
above 0.999. One of the groups may be deformed, since drives bend maps. The merged map of a group has walls that single
maps lack, so walls seen through count more than between single maps (`merging.seen_through`).

Two alignments between the same groups are no independent evidence, since the maps of a group show the same rooms. So
they are a bridge as well if each of the groups has several maps. Without this, two of 30 simulated buildings became one
group.

Refused alignments that agree are verified too. Otherwise 12 of 120 simulated maps of 20 buildings would become one
group of two buildings; the alignment of both sides gives its bridge a confidence of 0.
"""

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.map_graph.grouping import Group
from merging.map_graph.links import is_same_pose
from merging.merge_state import MergeState
from merging.merged_group import group_maps_of
from merging.nonrigid.search import align_deformable
from merging.seen_through import confidences_of_groups
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Progress

logger = logging.getLogger(__name__)

Sides = frozenset[frozenset[str]]
"""The maps on either side of a bridge."""


@dataclass(frozen=True)
class Bridge:
    """An alignment between two sides of a group. At most one other accepted alignment joins these sides."""

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


def without_refuted_bridges(
    found: MergeState, config: MergeConfig, progress: Progress, among: Collection[Pair] | None = None
) -> MergeState:
    """Split groups at bridges that the alignment of both sides does not confirm.

    With `among`, only bridges of these pairs are verified.
    """
    confirmed = set[Sides]()
    while True:
        refuted, fitting = refute_bridge(found, config, progress, confirmed, among)
        confirmed |= fitting
        if not refuted:
            return found
        found = found.with_alignments(refuted)


def refute_bridge(
    found: MergeState,
    config: MergeConfig,
    progress: Progress,
    confirmed: Collection[Sides] = (),
    among: Collection[Pair] | None = None,
) -> tuple[dict[Pair, Alignment], set[Sides]]:
    """Find a bridge that the alignment of both sides does not confirm, the most doubtful first.

    Bridges between `confirmed` sides are not verified again. Returns the changed alignments: those of the bridge, now
    refused, and others at the same pose; none if all bridges are confirmed. Also returns the sides that were confirmed.
    """
    fitting, alignments = set[Sides](), found.alignments
    joins = [join for group in found.groups for join in bridges_of(group, alignments, config)]
    joins = [join for join in joins if among is None or all(pair in among for pair in join.pairs)]
    for join in sorted(joins, key=lambda join: alignments[join.pair].confidence):
        if join.names in confirmed:
            continue
        confidence = _confidence_of_sides(join, found.maps, config, progress)
        if confidence < config.graph.min_whole:
            numbers = " and ".join(str(len(side)) for side in join.sides)
            why = f"the groups of {numbers} maps that it joins do not match as wholes (confidence {confidence:.2f})"
            logger.info("%s in %s: refused: %s", *join.pair[::-1], why)
            refuted = {pair: _refuted(each, pair, join, confidence, config) for pair, each in alignments.items()}
            for pair in join.pairs:
                reason = f"{why}: {alignments[pair].reason}"
                refuted[pair] = replace(refuted[pair], accepted=False, reason=reason, confidence=confidence)
            return {pair: changed for pair, changed in refuted.items() if changed is not alignments[pair]}, fitting
        fitting.add(join.names)
    return {}, fitting


def bridges_of(group: Group, alignments: Mapping[Pair, Alignment], config: MergeConfig) -> list[Bridge]:
    """Return the bridges of a group of more than two maps: the most certain alignment of each two sides."""
    bridges = dict[Sides, Bridge]()
    accepted = [pair for pair in group.used if alignments[pair].accepted]
    for pair in sorted(group.used, key=lambda pair: _certainty(alignments[pair]), reverse=True):
        found = alignments[pair]
        # Such an alignment joins nothing, like a refuted one.
        idle = not found.accepted and found.confidence < config.graph.min_whole
        if found.method != "correlation" or idle or len(group) <= 2:
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


def _refuted(found: Alignment, pair: Pair, bridge: Bridge, confidence: float, config: MergeConfig) -> Alignment:
    """Return an alignment whose confidence at the pose of a bridge is limited to a probability."""
    poses = {**bridge.sides[0], **bridge.sides[1]}
    if any(len(poses.keys() & side.keys() & set(pair)) != 1 for side in bridge.sides):
        return found
    motion = poses[pair[0]].inverse() @ poses[pair[1]]
    alternatives = tuple(
        replace(other, confidence=min(other.confidence, confidence))
        if is_same_pose(motion, other.T_target_source, config.graph, other.covariance)
        else other
        for other in found.alternatives
    )
    where = found.T_target_source
    if where is not None and is_same_pose(motion, where, config.graph, found.covariance):
        found = replace(found, accepted=False, confidence=min(found.confidence, confidence))
    return found if alternatives == found.alternatives else replace(found, alternatives=alternatives)


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


def _confidence_of_sides(join: Bridge, maps: Mapping[str, TbmMap], config: MergeConfig, progress: Progress) -> float:
    """Return the confidence of a bridge's pose in the alignment of both groups, each as one map; 0 without hypothesis.

    Groups that are too large for one map cannot be verified and give 1.
    """
    wholes = group_maps_of(maps, join.sides, config, progress)
    if not wholes:
        return 1.0
    grids = TbmMap(wholes[0].grid), TbmMap(wholes[1].grid)
    found = align_deformable(*grids, config)
    expected = wholes[0].T_common_map.inverse() @ wholes[1].T_common_map
    confidences = (
        float(confidence)
        for hypothesis, confidence in zip(found.hypotheses(), confidences_of_groups(found, *grids, config), strict=True)
        if is_same_pose(expected, hypothesis.T_target_source, config.graph, hypothesis.covariance)
    )
    return max(confidences, default=0.0)
