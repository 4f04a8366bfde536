"""Non-rigid registration of two maps: one of them is deformed at the best poses of the correlation.

The correlation works on coarse cells and tolerates some tenths of a metre, so it finds deformed maps too; only the
verification refuses them. A deformed map fits more poses than a rigid map. Therefore the deformed map must pass a new
rigid alignment without an initial guess, and must fit better than deformed rivals: other poses of the map, and poses of
its mirror image. Registered tiles leave some distance between corresponding walls, so walls agree at larger distances
than those of rigid maps. A deformed map often fits best at another pose than the first one of the correlation, so
deformations start at several poses (`merging.nonrigid.hypotheses`). The confidence follows from both tests and from the
share of the floor that agrees (`merging.nonrigid.deformed_model`).

If most walls agree at a rigid pose, it may be accepted although the maps are deformed. The other walls would be doubled
in the merged map, and the pose would fit only one part of the overlap. Therefore a map is also deformed at an accepted
pose, from this pose and from the poses of the correlation at the same place. The deformed map is kept if its odds
against chance are much larger.

The new alignment takes most of the time. The attempt ends before it if the deformed map does not fit much better than
the refused rigid map.
"""

import itertools
import logging
import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from merging.alignment import Alignment, Pair, bent_by, covariance_of, format_confidence, format_evidence
from merging.config import MergeConfig
from merging.fusion import at_resolution
from merging.map_graph.links import is_same_pose
from merging.merge_state import MergeState
from merging.nonrigid.deformation import DeformableMap, Deformation, DeformedMap
from merging.nonrigid.deformed_model import DeformedTests
from merging.nonrigid.hypotheses import DeformedPose, DeformedPoses, evidence_near
from merging.nonrigid.rivals import DeformedRivals, first_distinct
from merging.pairwise import CompressedGrid, most_held
from merging.registration.correlation import same_place
from merging.registration.features import Features
from merging.rigid_alignment import (
    WORTH_DEFORMING,
    PreparedMap,
    align_prepared,
    align_whole,
    comparison_resolution,
)
from merging.scoring import confidences, log_odds
from merging.walls import WallMap, without_walls
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

logger = logging.getLogger(__name__)


_HELD_CELLS = 1.6e7  # cells of maps with tiles that a process holds: 60 bytes each, so 1 GB
_MUCH_MORE_LIKELY = 7.0
"""Least odds ratio at which a deformed map is kept. It is reached by all of 50 accepted pairs of deformed maps, and by
four of 91 of undistorted maps, whose errors change by centimetres. Of refused pairs it is reached by 91 of 93 that are
rightly accepted then, and by 5 of 17 pairs of strangers that are likely after a deformation."""


@dataclass(frozen=True)
class NonrigidRegistration:
    """The registration of two maps, one of which is deformed."""

    alignment: Alignment
    """The accepted alignment: the nearest rigid transform, with the evidence of the deformed map."""
    deformation: Deformation
    """The deformation of the source to the target's frame."""

    def reversed(self) -> "NonrigidRegistration":
        """Return the registration of the target to the source."""
        return NonrigidRegistration(self.alignment.reversed(), self.deformation.inverse())


def align_deformable(target: TbmMap, source: TbmMap, config: MergeConfig) -> Alignment:
    """Align two maps rigidly; deform one of them if that is refused, or if the deformed map fits much better."""
    if not (config.nonrigid.enabled and config.method == "correlation"):
        return align_whole(target, source, config)
    resolution = comparison_resolution([target.grid, source.grid], config)
    fixed, moving = (deformable(tbm_map.grid, resolution, config) for tbm_map in (target, source))
    rigid = align_prepared(_prepared(fixed), _prepared(moving), config)
    found = register_nonrigid(fixed, moving, rigid, config)
    return rigid if found is None else found.alignment


def _prepared(source: DeformableMap | None) -> PreparedMap | None:
    return None if source is None else PreparedMap(source.structure, Features.none())


def deformable(grid: TbmGrid, resolution: float, config: MergeConfig) -> DeformableMap | None:
    """Return a deformable map of a grid at a resolution [m]; None if no cell is known."""
    return DeformableMap.of(at_resolution(grid, resolution), config) if grid.is_known().any() else None


def register_nonrigid(
    target: DeformableMap | None, source: DeformableMap | None, rigid: Alignment, config: MergeConfig
) -> NonrigidRegistration | None:
    """Deform the map with less wall after the rigid alignment of two maps of one resolution; None if it stays rigid.

    A rigid alignment of other grids, such as of short ranges, comes without `starts`, `decoys` and `evidence`.
    """
    if target is None or source is None or without_walls(target.structure, source.structure):
        return None
    if target.structure.wall_m < source.structure.wall_m:  # so that exchanged maps give the same result
        found = register_nonrigid(source, target, rigid.reversed(), config)
        return found and found.reversed()
    if rigid.accepted:
        return _register_accepted(target, source, rigid, config)
    if may_be_deformed(rigid, config):
        return _register_refused(target, source, rigid, config)
    return None


def _register_accepted(
    target: DeformableMap, source: DeformableMap, rigid: Alignment, config: MergeConfig
) -> NonrigidRegistration | None:
    """Deform the source near an accepted rigid pose.

    The confidence of the rigid alignment is kept, because the deformation changes the fit but not the place.
    """
    if rigid.T_target_source is None or rigid.evidence is None:
        return None
    fixed = target.structure
    pose = _deformed_near(rigid.T_target_source, rigid, fixed, source, config)
    if pose is None or pose.deformed is None:
        return None
    motion, structure, evidence, deformed = pose.motion, pose.structure, pose.evidence, pose.deformed
    limits = config.verification.limits()
    covariance = covariance_of(fixed, structure, motion, limits, config.covariance)
    alignment = rigid.at(motion, evidence, rigid.confidence, covariance)
    alignment = alignment.matched_by_walls(evidence, fixed.geometry.resolution)
    reason = f"{format_evidence(evidence)}; without deformation: {rigid.reason}"
    alignment = _deformed_alignment(alignment, deformed, rigid.confidence, reason)
    return NonrigidRegistration(alignment, deformed.deformation)


def _deformed_near(
    accepted: SE2, rigid: Alignment, fixed: WallMap, source: DeformableMap, config: MergeConfig
) -> DeformedPose | None:
    """Deform a map near an accepted pose; None if that is no better, or moves the map to another place."""
    # The accepted pose may fit only a part of the overlap; the correlation tolerates the distortion.
    others = [pose for pose in rigid.starts if not np.allclose(pose, accepted)]
    starts = [accepted, *same_place(others, accepted, source.structure)]
    pose = DeformedPoses(fixed, source, config).likeliest(starts, rigid.decoys)
    if pose is None or not _is_much_more_likely(pose, rigid, fixed):
        return None
    return pose if same_place([pose.motion], accepted, source.structure) else None


def _is_much_more_likely(pose: DeformedPose, rigid: Alignment, fixed: WallMap) -> bool:
    """Return whether a deformed map fits much better than the rigid one, and differs from it by half a cell.

    It is True if there is no evidence of the rigid map to compare with.
    """
    if pose.deformed is None or rigid.evidence is None or rigid.T_target_source is None:
        return pose.deformed is not None
    moved_m, _ = pose.deformed.deformation.residuals(rigid.T_target_source)
    gain = log_odds(pose.evidence, rigid.decoys) - log_odds(rigid.evidence, rigid.decoys)
    return moved_m >= 0.5 * fixed.geometry.resolution and gain >= math.log(_MUCH_MORE_LIKELY)


def _register_refused(
    target: DeformableMap, source: DeformableMap, refused: Alignment, config: MergeConfig
) -> NonrigidRegistration | None:
    """Deform the source at the best poses of the correlation; return the registration if it is likely enough."""
    found = attempt(target, source, refused, config)
    if found is None or found.tests.confidence < config.verification.min_confidence:
        return None
    return found.registration


class Attempt(NamedTuple):
    """A map that was deformed at the most likely pose and passed both tests there."""

    aligned: Alignment
    """The alignment of the deformed map without an initial guess."""
    deformed: DeformedMap
    tests: DeformedTests

    @property
    def registration(self) -> NonrigidRegistration:
        """The registration of the maps."""
        confidence = self.tests.confidence
        among = f"confidence {format_confidence(self.tests.among_rivals)} among deformed rivals"
        reason = f"confidence {format_confidence(confidence)}: {among}; after deformation: {self.aligned.reason}"
        return NonrigidRegistration(
            _deformed_alignment(self.aligned, self.deformed, confidence, reason), self.deformed.deformation
        )


def attempt(target: DeformableMap, source: DeformableMap, refused: Alignment, config: MergeConfig) -> Attempt | None:
    """Deform the source at the most likely start; return it if it is aligned there and beats its rivals.

    Both tests are passed with `min_confidence`. The deformed map and the rigid one are compared by the same distances.
    """
    fixed, moving = target.structure, source.structure
    config = config.of_deformed_maps()
    poses = DeformedPoses(fixed, source, config)
    starts = refused.starts or first_distinct(poses.proposals, moving, config.nonrigid.places)
    if refused.T_target_source is not None and refused.evidence is not None:
        refused = replace(refused, evidence=evidence_near(fixed, moving, refused.T_target_source, config))
    pose = poses.likeliest(starts, refused.decoys)
    if pose is None or not _is_much_more_likely(pose, refused, fixed):
        return None
    deformed = PreparedMap(pose.structure, Features.none())
    realigned = align_prepared(_prepared(target), deformed, config, refused.decoys)
    if not _is_aligned_at(pose.motion, realigned, config):
        return None
    rivals = DeformedRivals.of(poses, pose)
    confidence = confidences(rivals.evidence, rivals.decoys, deformed=True)[0]
    if confidence < config.verification.min_confidence or pose.deformed is None:
        return None
    return Attempt(realigned, pose.deformed, DeformedTests.of(realigned.confidence, confidence, pose.evidence))


def _is_aligned_at(pose: SE2, found: Alignment, config: MergeConfig) -> bool:
    """Return whether an alignment was accepted at a pose T_target_source."""
    aligned = found.T_target_source
    return found.accepted and aligned is not None and is_same_pose(pose, aligned, config.graph, found.covariance)


def _deformed_alignment(aligned: Alignment, deformed: DeformedMap, confidence: float, reason: str) -> Alignment:
    """Return the alignment of a deformed map, from the rigid alignment that verified it."""
    degrees = math.degrees(deformed.residual_rad)
    bent = f"one map was deformed by {deformed.residual_m:.2f} m and {degrees:.1f} degrees"
    if (scale := deformed.deformation.scale_error()) is not None:
        larger = 100.0 * (max(scale, 1.0 / scale) - 1.0)
        bent += f", mostly because one map is {larger:.1f} % larger: is the resolution of a map wrong?"
    return replace(
        aligned,
        reason=f"{bent}: {reason}",
        T_target_source=deformed.motion,
        bent_m=deformed.residual_m,
        confidence=confidence,
        covariance=aligned.covariance and bent_by(aligned.covariance, deformed.residual_m, deformed.residual_rad),
        alternatives=(),
    )


def may_be_deformed(refused: Alignment, config: MergeConfig) -> bool:
    """Return whether a pair was refused although one pose stands out in the correlation, or its rigid pose is likely.

    The correlation tolerates some tenths of a metre, so the true pose of a deformed map usually stands out in it. In a
    repetitive building it may not, but there the rigid pose may be likely.
    """
    stands_out, is_likely = refused.lead >= config.nonrigid.min_lead, refused.confidence >= WORTH_DEFORMING
    return not refused.accepted and (stands_out or is_likely)


def register_pairs(found: MergeState, config: MergeConfig, executor: Executor) -> dict[Pair, NonrigidRegistration]:
    """Register pairs of maps non-rigidly; return the accepted registrations.

    These are refused pairs of maps of different groups, and accepted pairs that fit much better if a map is deformed.
    """
    pairs = [pair for pair in found.apart() if may_be_deformed(found.alignments[pair], config)]
    pairs += _joining_alone(found)
    if not (pairs and config.nonrigid.enabled and config.method == "correlation"):
        return {}
    grids = {name: tbm_map.grid for name, tbm_map in found.maps.items()}
    sizes = {pair: comparison_resolution([grids[name] for name in pair], config) for pair in pairs}
    sent = {name: CompressedGrid(grids[name]) for name in dict.fromkeys(itertools.chain.from_iterable(pairs))}
    maps = {
        (name, size): Call(f"map {name} {size}", _deformable, (sent[name], size, config))
        for pair, size in sizes.items()
        for name in pair
    }
    calls = [
        Call(
            f"{source} deformed onto {target}",
            register_nonrigid,
            (maps[target, size], maps[source, size], _of_own_grids(found, (target, source)), config),
        )
        for (target, source), size in sizes.items()
    ]
    registrations: list[NonrigidRegistration | None] = executor.results(
        calls, "deforming", "pairs", most_held((grids[name] for name in sent), _HELD_CELLS)
    )
    accepted = {pair: result for pair, result in zip(pairs, registrations, strict=True) if result is not None}
    for (target, source), result in accepted.items():
        logger.info("%s in %s: accepted: %s", source, target, result.alignment.reason)
        if (scale := result.deformation.scale_error()) is not None:
            larger, smaller = (target, source) if scale > 1.0 else (source, target)
            logger.warning(
                "%s is %.1f %% larger than %s: correct the map with the wrong resolution",
                larger,
                100.0 * (max(scale, 1.0 / scale) - 1.0),
                smaller,
            )
    return accepted


def _joining_alone(found: MergeState) -> list[Pair]:
    """Return the accepted pairs that alone join one of their maps to its group.

    Maps with keyframes are left out, since their drives are optimised jointly, and pairs aligned by other grids.
    """
    used = [pair for group in found.groups for pair in group.used]
    counts = Counter(itertools.chain.from_iterable(used))
    return [
        pair
        for pair in used
        if found.alignments[pair].accepted
        and found.alignments[pair].method == "correlation"
        and pair not in found.evidence_grids
        and min(counts[name] for name in pair) == 1
        and not all(found.maps[name].drives for name in pair)
    ]


def _of_own_grids(found: MergeState, pair: Pair) -> Alignment:
    """Return the alignment of a pair, without its poses and evidence if it is of other grids."""
    alignment = found.alignments[pair]
    return replace(alignment, starts=(), decoys=(), evidence=None) if pair in found.evidence_grids else alignment


def _deformable(sent: CompressedGrid, resolution: float, config: MergeConfig) -> DeformableMap | None:
    return deformable(sent.grid, resolution, config)
