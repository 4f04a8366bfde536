"""Verification of the bridges of the map graph.

A few walls of two maps may agree by chance. If two buildings have similar rooms, several refused alignments agree with
a wrong pose. So each bridge is verified by an alignment of both groups, each as one map. A confident bridge is verified
too: of the 45,000 pairs of 300 maps, six of different buildings were accepted, one with a confidence above 0.999.

Drift distorts maps. So the drives of the whole group are optimised jointly first, and one side may be deformed. The
merged map of a group has walls that single maps lack, so walls seen through count more than between single maps
(`merging.bridges.seen_through`).

Refused alignments that agree are verified too. Otherwise 12 of 120 simulated maps of 20 buildings would become one
group of two buildings.
"""

import logging
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from merging.alignment import Alignment, Pair, format_confidence
from merging.bridges.bridge import TOO_WEAK_TO_JOIN, Bridge, Sides, bridges_of
from merging.bridges.seen_through import confidences_of_groups
from merging.config import MergeConfig
from merging.fusion import CellSizeError
from merging.joint_slam import JointRefinement
from merging.map_graph.grouping import Group
from merging.map_graph.links import is_same_pose
from merging.merge_state import MergeState
from merging.merged_group import group_maps_of, jointly_refined
from merging.nonrigid.search import align_deformable
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Progress

logger = logging.getLogger(__name__)

_UNVERIFIED = 1.0
"""Confidence of a bridge that cannot be verified, as its groups are too large for one map or for the memory."""


def without_refuted_bridges(
    found: MergeState, config: MergeConfig, progress: Progress, among: Collection[Pair] | None = None
) -> MergeState:
    """Split groups at bridges that the alignment of both sides does not confirm.

    With `among`, only bridges made of these pairs alone are verified.
    """
    confirmed = set[Sides]()
    while True:
        refuted, fitting = verify_bridges(found, config, progress, confirmed, among)
        confirmed |= fitting
        if not refuted:
            return found
        found = found.with_alignments(refuted)


def verify_bridges(
    found: MergeState,
    config: MergeConfig,
    progress: Progress,
    confirmed: Collection[Sides] = (),
    among: Collection[Pair] | None = None,
) -> tuple[dict[Pair, Alignment], set[Sides]]:
    """Verify the bridges of each group by an alignment of both sides, the least confident first, until one fails.

    Bridges between `confirmed` sides are not verified again. Returns the changed alignments: those of the bridges, now
    refused, and others at the same poses; none if all bridges are confirmed. Also returns the confirmed sides.
    """
    fitting, alignments = set[Sides](), dict(found.alignments)
    for group in found.groups:
        bridges = [
            bridge
            for bridge in bridges_of(group, found.alignments, config)
            if bridge.names not in confirmed and (among is None or all(pair in among for pair in bridge.pairs))
        ]
        if not bridges:
            continue
        with progress.during("verifying bridges"):
            for bridge, confidence in _confidences_of(bridges, group, found, config, progress):
                if confidence < config.verification.min_confidence:
                    alignments = _with_refused(bridge, alignments, confidence, config)
                    break
                fitting.add(bridge.names)
    return {pair: each for pair, each in alignments.items() if each is not found.alignments[pair]}, fitting


def _with_refused(
    bridge: Bridge, alignments: Mapping[Pair, Alignment], confidence: float, config: MergeConfig
) -> dict[Pair, Alignment]:
    """Refuse the alignments at the pose of a bridge, and limit their confidence so that they join no groups alone."""
    numbers, limit = " and ".join(str(len(side)) for side in bridge.sides), config.verification.min_confidence
    stated = f"confidence {format_confidence(confidence)} is under {limit:g}"
    why = f"the groups of {numbers} maps that it joins do not match as wholes ({stated})"
    logger.info("%s in %s: refused: %s", *bridge.pair[::-1], why)
    confidence = min(confidence, TOO_WEAK_TO_JOIN)  # so the pair is no bridge again, and the verification ends
    refuted = {pair: _refuted(each, pair, bridge, confidence, why, config) for pair, each in alignments.items()}
    for pair in bridge.pairs:
        reason = f"{why}: {alignments[pair].reason}"
        refuted[pair] = replace(refuted[pair], accepted=False, reason=reason, confidence=confidence)
    return refuted


def _refuted(
    found: Alignment, pair: Pair, bridge: Bridge, confidence: float, why: str, config: MergeConfig
) -> Alignment:
    """Return an alignment whose confidence at the pose of a bridge is limited to a probability, with the reason."""
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
        reason = f"{why}: {found.reason}" if found.confidence > confidence else found.reason
        found = replace(found, accepted=False, reason=reason, confidence=min(found.confidence, confidence))
    return found if alternatives == found.alternatives else replace(found, alternatives=alternatives)


def _confidences_of(
    bridges: Sequence[Bridge], group: Group, found: MergeState, config: MergeConfig, progress: Progress
) -> Iterator[tuple[Bridge, float]]:
    """Yield the bridges of a group with their confidences, the least confident alignment first."""
    try:
        joint = jointly_refined(found.maps, group.poses, config, progress)
    except MemoryError:
        logger.warning("the bridges between %s are not verified: memory has run out", ", ".join(group.poses))
        yield from ((bridge, _UNVERIFIED) for bridge in bridges)
        return
    for bridge in sorted(bridges, key=lambda bridge: found.alignments[bridge.pair].confidence):
        try:
            yield bridge, _confidence_of(bridge, found, joint, config, progress)
        except (CellSizeError, MemoryError) as error:
            why = str(error) if isinstance(error, CellSizeError) else "memory has run out"
            logger.warning("the bridge between %s and %s is not verified: %s", *bridge.pair, why)
            yield bridge, _UNVERIFIED


def _confidence_of(
    bridge: Bridge, found: MergeState, joint: JointRefinement | None, config: MergeConfig, progress: Progress
) -> float:
    """Return the confidence of the relative pose of both sides of a bridge, from an alignment of each as one map."""
    # The farther walls of maps that align by short ranges only are displaced, and would refute the bridge.
    is_short = any(pair in found.evidence_grids for pair in bridge.pairs)
    max_range = config.short_range.range_m if is_short else math.inf
    here, there = group_maps_of(found.maps, bridge.sides, config, progress, joint, max_range)
    grids = TbmMap(here.grid), TbmMap(there.grid)
    aligned, expected = align_deformable(*grids, config), here.T_common_map.inverse() @ there.T_common_map
    return sum(
        float(confidence)
        for hypothesis, confidence in zip(
            aligned.hypotheses(), confidences_of_groups(aligned, *grids, config), strict=True
        )
        if is_same_pose(expected, hypothesis.T_target_source, config.graph, hypothesis.covariance)
    )
