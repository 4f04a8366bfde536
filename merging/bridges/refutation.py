"""Verification of the bridges of the map graph.

A few walls of two maps may agree by chance. If two buildings have similar rooms, several refused alignments agree with
a wrong pose. So each bridge is verified by an alignment of both groups, each as one map of all its walls. A confident
bridge is verified too: of the 45,000 pairs of 300 maps, six of different buildings were accepted, one with a confidence
above 0.999. One of the groups may be deformed, since drives bend maps. The merged map of a group has walls that single
maps lack, so walls seen through count more than between single maps (`merging.bridges.seen_through`).

Refused alignments that agree are verified too. Otherwise 12 of 120 simulated maps of 20 buildings would become one
group of two buildings; the alignment of both sides gives its bridge a confidence of 0.
"""

import logging
from collections.abc import Collection, Mapping
from dataclasses import replace

from merging.alignment import Alignment, Pair
from merging.bridges.bridge import Bridge, Sides, bridges_of
from merging.bridges.seen_through import confidences_of_groups
from merging.config import MergeConfig
from merging.map_graph.links import is_same_pose
from merging.merge_state import MergeState
from merging.merged_group import group_maps_of
from merging.nonrigid.search import align_deformable
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Progress

logger = logging.getLogger(__name__)


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
