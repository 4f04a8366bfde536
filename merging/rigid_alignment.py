"""Rigid alignment of two maps: hypotheses, their evidence and confidence, and the verdict."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from merging.alignment import Alignment, PoseHypothesis, covariance_of, format_confidence, format_evidence
from merging.baselines import BASELINES, align_baseline
from merging.config import MergeConfig
from merging.config.registration import VerificationConfig
from merging.fusion import at_resolution, check_cell_size
from merging.registration.correlation import Candidate, best_distinct, best_of, lead_of, propose, refine_all
from merging.registration.features import Features, describe, match
from merging.registration.ransac import find_consensus
from merging.scoring import confidences, score_hypotheses
from merging.verification import Evidence, examine
from merging.walls import WallMap, without_walls
from tbmslam.belief.grid import TbmGrid
from tbmslam.map.tbm_map import TbmMap

_ALTERNATIVES = 4
"""Largest number of alternatives."""
_WORTH_NAMING = 0.01
"""Confidence from which an alternative is always kept."""
WORTH_DEFORMING = 0.1
"""Least confidence of a rigid pose from which a deformation starts; one in ten pairs of different places reaches it."""
_DECOYS = 3
"""Largest number of decoys that an alignment keeps."""


@dataclass(frozen=True)
class PreparedMap:
    """One map, prepared once for alignments with many others."""

    structure: WallMap
    features: Features
    """Its keypoints; none if the method does not use them."""
    grid: TbmGrid | None = None
    """The grid itself, for the related work's methods; None for others."""


def prepared(grid: TbmGrid, resolution: float, config: MergeConfig) -> PreparedMap | None:
    """Prepare a grid at a cell size [m]; None for an empty grid."""
    if not grid.is_known().any():
        return None
    seen = at_resolution(grid, resolution)
    features = describe(seen, config.features) if config.method == "features" else Features.none()
    kept = seen if config.method in BASELINES else None
    return PreparedMap(WallMap.from_grid(seen, config.structure), features, kept)


def comparison_resolution(grids: list[TbmGrid], config: MergeConfig) -> float:
    """Return the cell size at which maps are compared [m]: a fine map can be read coarsely, not the reverse."""
    resolution = config.resolution or max(grid.geometry.resolution for grid in grids)
    for size in (resolution, *(grid.geometry.resolution for grid in grids)):
        check_cell_size(size)
    return resolution


def align_whole(target: TbmMap, source: TbmMap, config: MergeConfig | None = None) -> Alignment:
    """Estimate the pose of a source map in the frame of a target map rigidly; see `merging.merger.align`."""
    config = config or MergeConfig()
    resolution = comparison_resolution([target.grid, source.grid], config)
    if config.method in BASELINES:
        return align_baseline(target.grid, source.grid, resolution, config)
    return align_prepared(prepared(target.grid, resolution, config), prepared(source.grid, resolution, config), config)


def align_prepared(
    target: PreparedMap | None, source: PreparedMap | None, config: MergeConfig, decoys: Sequence[Evidence] = ()
) -> Alignment:
    """Align two prepared maps; see `merging.merger.align`.

    `decoys` that were found before, of nearly the same maps, may already refuse the pair.
    """
    if target is None or source is None:
        empty = "target" if target is None else "source"
        return Alignment(config.method, accepted=False, reason=f"the {empty} map is empty: no cell of it is known")
    if target.grid is not None and source.grid is not None:
        return BASELINES[config.method](target.grid, source.grid, config)
    if bare := without_walls(target.structure, source.structure):
        return Alignment(config.method, accepted=False, reason=f"{bare}: their relative pose is unknown")
    if config.method == "features":
        return _by_features(target, source, config)
    return _by_correlation(target.structure, source.structure, config, decoys)


def _by_features(target: PreparedMap, source: PreparedMap, config: MergeConfig) -> Alignment:
    """Align by keypoints (the paper, section IV), then verify by walls."""
    matches = match(target.features, source.features, config.features)
    consensus = find_consensus(matches, config.consensus)
    among = f"{len(matches)} matches of {len(target.features)} and {len(source.features)} keypoints"
    if consensus is None:
        reason = f"no inliers among {among}, fewer than {config.consensus.min_inliers}"
        return Alignment("features", accepted=False, reason=reason, matches=len(matches))
    found = Alignment(
        method="features",
        accepted=False,
        reason=f"{consensus.count} inliers among {among}",
        T_target_source=consensus.T_target_source,
        matches=len(matches),
        inliers=consensus.count,
        rmse_m=consensus.rmse_m,
        scale=consensus.scale,
    )
    if consensus.count < config.consensus.min_inliers:
        return replace(found, reason=f"only {found.reason}, fewer than {config.consensus.min_inliers}")
    if not abs(consensus.scale - 1.0) <= config.consensus.max_scale_deviation:
        fits = f"the {consensus.count} inliers fit best at a scale of {consensus.scale:.3f}"
        limit = f"farther from 1 than {config.consensus.max_scale_deviation:g}"
        return replace(found, reason=f"{fits}, {limit}: is the resolution of a map wrong?")
    motion = refine_all(target.structure, source.structure, [consensus.T_target_source], config)[0]
    evidence = examine(target.structure, source.structure, motion, config.verification)
    return _judged(found, [(motion, evidence)], (target.structure, source.structure), config)


def _by_correlation(
    target: WallMap, source: WallMap, config: MergeConfig, decoys: Sequence[Evidence] = ()
) -> Alignment:
    """Align by correlation over all rotations and translations."""
    if source.wall_m > target.wall_m:  # the search is not symmetric, but the order of the maps must not matter
        return _by_correlation(source, target, config, decoys).reversed()
    proposals = propose(target, source, config.correlation)
    candidates = best_of(proposals.motions, target, source, config)
    reason = "no rotation and translation brings the walls together"
    starts = tuple(best_distinct(proposals.motions, proposals.scores, source, config.nonrigid.places))
    found = Alignment("correlation", accepted=False, reason=reason, lead=lead_of(proposals, source), starts=starts)
    if not candidates:
        return found
    return _judged(found, candidates, (target, source), config, decoys)


def _judged(
    found: Alignment,
    candidates: list[Candidate],
    maps: tuple[WallMap, WallMap],
    config: MergeConfig,
    known_decoys: Sequence[Evidence] = (),
) -> Alignment:
    """Accept or refuse the most likely candidate, with the reason."""
    limits = config.verification
    likely, decoys = score_hypotheses(*maps, [evidence for _, evidence in candidates], config, known_decoys)
    ranked = sorted(zip(likely, candidates, strict=True), key=lambda ranked_pair: -ranked_pair[0])
    confidence, (motion, evidence) = ranked[0]
    others = [
        PoseHypothesis(other, p, e.agreed_wall_m, covariance_of(*maps, other, limits.limits(), config.covariance))
        for p, (other, e) in ranked[1 : 1 + _ALTERNATIVES]
        if p >= min(_WORTH_NAMING, limits.ambiguous_share * confidence)
    ]
    if found.method == "correlation":
        found = found.matched_by_walls(evidence, maps[0].geometry.resolution)
    accepted = confidence >= limits.min_confidence and evidence.overlap_m2 >= limits.min_overlap_m2
    ambiguous = not accepted and _is_ambiguous(confidence, evidence, others, limits)
    covariance = covariance_of(*maps, motion, limits.limits(), config.covariance)
    reason = _reason(found, confidence, evidence, others if ambiguous else [], limits)
    if not accepted:
        reason += _mirrored(confidence, [evidence for _, evidence in candidates], decoys, limits)
    return replace(
        found.at(motion, evidence, confidence, covariance),
        accepted=accepted,
        ambiguous=ambiguous,
        reason=reason,
        alternatives=tuple(others),
        decoys=tuple(decoys[:_DECOYS]),
        starts=(*found.starts, motion) if found.starts and confidence >= WORTH_DEFORMING else found.starts,
    )


def _mirrored(confidence: float, places: list[Evidence], decoys: list[Evidence], config: VerificationConfig) -> str:
    """Return the remark on the mirror image of a refused map: it fits instead of the map, or as well."""
    if not decoys:
        return ""
    of_image, decoy = max(zip(confidences(decoys, places), decoys, strict=True), key=lambda of_decoy: of_decoy[0])
    if of_image >= config.min_confidence:
        return (
            f"; the mirror image of the source would fit with confidence {format_confidence(of_image)}: "
            "is one map's picture flipped, or was a laser mounted upside down?"
        )
    # Without its mirror image the map would be accepted.
    if confidence >= config.min_confidence or max(confidences(places, [])) < config.min_confidence:
        return ""
    return (
        f"; the mirror image of the source also fits ({decoy.agreed_wall_m:.1f} m agree, "
        f"{decoy.agreement:.0%}): the place may be symmetric, or the fit may be by chance"
    )


def _is_ambiguous(
    confidence: float, evidence: Evidence, others: list[PoseHypothesis], config: VerificationConfig
) -> bool:
    """Return whether the maps fit well at several poses."""
    fits = (
        evidence.agreed_wall_m >= config.min_ambiguous_wall_m and evidence.agreement >= config.min_ambiguous_agreement
    )
    return fits and any(other.confidence >= config.ambiguous_share * confidence for other in others)


def _reason(
    found: Alignment, confidence: float, evidence: Evidence, rivals: list[PoseHypothesis], config: VerificationConfig
) -> str:
    """Return the reason of a verdict, with the numbers."""
    before = f"{found.reason}; " if found.method == "features" else ""
    facts = format_evidence(evidence)
    if evidence.overlap_m2 < config.min_overlap_m2:
        return f"{before}overlap of {evidence.overlap_m2:.1f} m2 is under {config.min_overlap_m2:g} m2"
    sure = format_confidence(confidence)
    if rivals:
        places = f"{len(rivals) + 1} places" if len(rivals) < _ALTERNATIVES else f"{len(rivals) + 1} places or more"
        return f"{before}ambiguous: {places} fit about as well, the best with confidence {sure}: {facts}"
    if confidence >= config.min_confidence:
        return f"{before}confidence {sure}: {facts}"
    return f"{before}confidence {sure} is under {config.min_confidence:g}: {facts}"
