"""Bridges of the map graph: joins of groups that hang on doubtful alignments. Both groups as wholes must bear them out.

Of two maps few walls may agree by chance, and where two buildings have a room alike, several refused alignments agree
on it. Where other maps know the same two places, all of their walls must agree there as well; so what joins two groups
is looked at once more with everything that they know.

Without the check of refused alignments that agree, 12 of 120 simulated maps of 20 buildings become one group of two
buildings, whose wholes give their place a confidence of 0.
"""

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.map_graph.grouping import Group
from merging.map_graph.hypothesis import is_same_pose
from merging.merge_state import MergeState
from merging.merged_group import group_maps_of
from merging.pairwise import align_all
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor

logger = logging.getLogger(__name__)

Sides = tuple[Pair, frozenset[str], frozenset[str]]
"""An alignment, and the maps on either side of it."""


@dataclass(frozen=True)
class Bridge:
    """A doubtful alignment that joins two sides of a group which no accepted one joins besides.

    Parameters
    ----------
    pair
        Whose it is.
    sides
        The poses of the maps on the target's side and on the source's, in the group's frame.
    """

    pair: Pair
    sides: tuple[Mapping[str, SE2], Mapping[str, SE2]]

    @property
    def T_target_source(self) -> SE2:
        """The place that it names."""
        target, source = self.pair
        return self.sides[0][target].inverse() @ self.sides[1][source]

    @property
    def names(self) -> Sides:
        """The pair, and the maps on either side."""
        return self.pair, frozenset(self.sides[0]), frozenset(self.sides[1])


def without_refuted_bridges(found: MergeState, config: MergeConfig, executor: Executor) -> MergeState:
    """Part groups that one doubtful alignment joined, which all their maps together do not bear out."""
    stood = set[Sides]()
    while True:
        refuted, fitting = refute_bridge(found, config, executor, stood)
        stood |= fitting
        if not refuted:
            return found
        found = found.with_alignments(refuted)


def refute_bridge(
    found: MergeState,
    config: MergeConfig,
    executor: Executor,
    stood: Collection[Sides] = (),
) -> tuple[dict[Pair, Alignment], set[Sides]]:
    """Look for a bridge between groups which as wholes do not fit so, the most doubtful first.

    Parameters
    ----------
    found
        The maps, and what is known of them so far.
    config
        Below which confidence a lone alignment is doubted, and how little the wholes may give its place.
    executor
        Who aligns them.
    stood
        The groups that fitted before; they are not aligned again.

    Returns
    -------
    Its alignment, refused now, and all others that name the same place; none where all bridges stand; and the groups
    that fit.
    """
    fitting, alignments = set[Sides](), found.alignments
    joins = [join for group in found.groups for join in bridges_of(group, alignments, config)]
    for join in sorted(joins, key=lambda join: alignments[join.pair].confidence):
        if join.names in stood:
            continue
        likely = _likely_as_wholes(join, found.maps, config, executor)
        if likely < config.graph.min_whole:
            before, numbers = alignments[join.pair], " and ".join(str(len(side)) for side in join.sides)
            reason = f"groups of {numbers} maps, which it joins, do not match as wholes ({likely:.2f}): {before.reason}"
            logger.info("%s in %s: refused: %s", *join.pair[::-1], reason)
            refuted = {pair: _refuted(one, pair, join, likely, config) for pair, one in alignments.items()}
            refuted[join.pair] = replace(refuted[join.pair], accepted=False, reason=reason, confidence=likely)
            return {pair: one for pair, one in refuted.items() if one is not alignments[pair]}, fitting
        fitting.add(join.names)
    return {}, fitting


def bridges_of(group: Group, alignments: Mapping[Pair, Alignment], config: MergeConfig) -> list[Bridge]:
    """Return the bridges of a group of more than two maps: of any two sides the surest alignment."""
    bridges = dict[frozenset[frozenset[str]], Bridge]()
    for pair in sorted(group.used, key=lambda one: _sureness(alignments[one]), reverse=True):
        found = alignments[pair]
        sure = found.accepted and found.confidence >= config.graph.sure_alone
        idle = not found.accepted and found.confidence < config.graph.min_whole  # as what was refuted: it joins nothing
        if found.method != "correlation" or sure or idle or len(group) <= 2:
            continue
        sides = _parted_without(pair, group, alignments, config)
        if sides is not None and frozenset(sides) not in bridges:
            here, there = ({name: pose for name, pose in group.poses.items() if name in side} for side in sides)
            bridges[frozenset(sides)] = Bridge(pair, (here, there))
    return list(bridges.values())


def _sureness(found: Alignment) -> tuple[bool, float]:
    return found.accepted, found.confidence


def _refuted(found: Alignment, pair: Pair, bridge: Bridge, likely: float, config: MergeConfig) -> Alignment:
    """Return an alignment in which the place that a bridge names is no likelier than a probability."""
    poses = {**bridge.sides[0], **bridge.sides[1]}
    if any(len(poses.keys() & side.keys() & set(pair)) != 1 for side in bridge.sides):
        return found
    motion = poses[pair[0]].inverse() @ poses[pair[1]]
    others = tuple(
        replace(one, confidence=min(one.confidence, likely))
        if is_same_pose(motion, one.T_target_source, config.graph, one.covariance)
        else one
        for one in found.alternatives
    )
    where = found.T_target_source
    if where is not None and is_same_pose(motion, where, config.graph, found.covariance):
        found = replace(found, accepted=False, confidence=min(found.confidence, likely))
    return found if others == found.alternatives else replace(found, alternatives=others)


def _parted_without(
    pair: Pair, group: Group, alignments: Mapping[Pair, Alignment], config: MergeConfig
) -> tuple[frozenset[str], frozenset[str]] | None:
    """Return the maps on the target's side and on the source's; None where other accepted alignments join these.

    Refused ones that agree with the group's poses put maps on the side which they say more surely, but join no sides;
    what nothing puts on either is on none.
    """
    others = [one for one in group.used if one != pair]
    surest_first = sorted(others, key=lambda one: _sureness(alignments[one]), reverse=True)
    # A map that lies where its user put it, whatever the walls say, knows nothing of what lies there.
    unfounded = {
        one
        for one in others
        if alignments[one].method == "prior" and alignments[one].confidence < config.verification.min_confidence
    }
    if unfounded and _sides(pair, group, alignments, surest_first) is None:
        return None
    return _sides(pair, group, alignments, [one for one in surest_first if one not in unfounded])


def _sides(
    pair: Pair, group: Group, alignments: Mapping[Pair, Alignment], surest_first: Sequence[Pair]
) -> tuple[frozenset[str], frozenset[str]] | None:
    """Return the maps on either side of a pair that these alignments put there; None where accepted ones join both."""
    sides = {name: frozenset({name}) for name in group.poses}
    for one in surest_first:
        both = sides[one[0]] | sides[one[1]]
        if both.issuperset(pair):
            if alignments[one].accepted:
                return None
            continue
        sides |= dict.fromkeys(both, both)
    return sides[pair[0]], sides[pair[1]]


def _likely_as_wholes(join: Bridge, maps: Mapping[str, TbmMap], config: MergeConfig, executor: Executor) -> float:
    """Return the confidence that two groups, each as one map, give a join's place; 0 if they do not offer it.

    Groups too large to be one map cannot speak against it: then it is 1.
    """
    target, source = join.pair
    wholes = group_maps_of(maps, dict(zip(join.pair, join.sides, strict=True)), config, executor.progress)
    if len(wholes) < 2:
        return 1.0
    grids = {name: TbmMap(whole.grid) for name, whole in wholes.items()}
    found = align_all(grids, config, executor, [join.pair])[join.pair]
    told = wholes[target].poses[target] @ join.T_target_source @ wholes[source].poses[source].inverse()
    likely = (
        hypothesis.confidence
        for hypothesis in found.hypotheses()
        if is_same_pose(told, hypothesis.T_target_source, config.graph, hypothesis.covariance)
    )
    return max(likely, default=0.0)
