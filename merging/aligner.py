"""Two maps, and where one lies in the other's frame."""

from dataclasses import dataclass, replace

import numpy as np

from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.consensus import find_consensus
from merging.correlation import propose
from merging.features import Features, describe, match
from merging.refinement import refine
from merging.structure import Structure
from merging.verification import examine, objection, support_m
from merging.warping import at_resolution
from tbmslam.grid import TbmGrid
from tbmslam.se2 import SE2, FloatArray, wrap_angle
from tbmslam.tbm_map import TbmMap

_FEW_WALLS = 400
"""Surface cells that are enough to tell promising proposals from hopeless ones."""
_ELSEWHERE_M, _ELSEWHERE_RAD = 1.0, 0.15
"""Alignments farther apart than this are different answers, not one answer twice."""


@dataclass(frozen=True)
class View:
    """One map as the aligner looks at it, so that a map met by many others is looked at once.

    Parameters
    ----------
    structure
        Its walls and free space.
    features
        Its keypoints; none where the method has no use for them.
    """

    structure: Structure
    features: Features


def view_of(grid: TbmGrid, resolution: float, config: MergeConfig) -> View | None:
    """Look at a grid in cells of the given size [m]; None where nothing in it is known."""
    if not grid.is_known().any():
        return None
    seen = at_resolution(grid, resolution)
    features = describe(seen, config.features) if config.method == "features" else Features.none()
    return View(Structure.from_grid(seen, config.structure), features)


def comparison_resolution(grids: list[TbmGrid], config: MergeConfig) -> float:
    """Return the cell size at which maps are compared [m]: a fine map can be read coarsely, not the reverse."""
    return config.resolution or max(grid.geometry.resolution for grid in grids)


def align(target: TbmMap, source: TbmMap, config: MergeConfig | None = None) -> Alignment:
    """Find where a source map lies in a target map's frame, without any initial guess.

    Returns
    -------
    The alignment; where there is none that can be believed, a refusal that says why.
    """
    config = config or MergeConfig()
    resolution = comparison_resolution([target.grid, source.grid], config)
    return align_views(view_of(target.grid, resolution, config), view_of(source.grid, resolution, config), config)


def align_views(target: View | None, source: View | None, config: MergeConfig) -> Alignment:
    """Find where the source lies in the target's frame; see `align`."""
    if target is None or source is None:
        empty = "target" if target is None else "source"
        return Alignment(config.method, accepted=False, reason=f"the {empty} map is empty: no cell of it was seen")
    if config.method == "features":
        return _by_features(target, source, config)
    return _by_correlation(target.structure, source.structure, config)


def _by_features(target: View, source: View, config: MergeConfig) -> Alignment:
    """Align by keypoints (the paper, section IV), then let the walls confirm it."""
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
    motion = refine(target.structure, source.structure, consensus.T_target_source, config.refinement)
    return _judged(found, motion, target.structure, source.structure, config)


def _by_correlation(target: Structure, source: Structure, config: MergeConfig) -> Alignment:
    """Align by the best of all rotations and shifts, if no other place is nearly as good."""
    ranked = _finalists(target, source, propose(target, source, config.correlation), config)
    found = Alignment("correlation", accepted=False, reason="no rotation and shift brings the walls together")
    if not ranked or ranked[0][0] <= 0.0:
        return found
    best_m, motion = ranked[0]
    rival = max(ranked[1][0], 0.0) / best_m if len(ranked) > 1 else 0.0
    found = replace(found, reason=f"no other place has more than {rival:.0%} of its support")
    judged = _judged(found, motion, target, source, config)
    if not judged.accepted or rival <= config.verification.max_rival:
        return judged
    reason = f"ambiguous: another place has {rival:.0%} of its support, over {config.verification.max_rival:.0%}"
    return replace(judged, accepted=False, reason=reason)


def _finalists(
    target: Structure, source: Structure, proposals: list[SE2], config: MergeConfig
) -> list[tuple[float, SE2]]:
    """Refine proposals, first roughly and then the best of them wholly; return their supports [m] and motions.

    The best comes first, and none puts the source where a better one puts it already.
    """
    centre = source.points.mean(axis=0) if len(source.points) else np.zeros(2)
    rough = config.refinement.model_copy(update={"iterations": config.refinement.rough_iterations})
    ranked = [(0.0, motion) for motion in proposals]
    for limit, how in ((_FEW_WALLS, rough), (None, config.refinement)):
        refined = [refine(target, source, motion, how, limit) for _, motion in ranked]
        supports = [support_m(target, source, motion, config.verification, limit) for motion in refined]
        ranked = []
        for support, motion in sorted(zip(supports, refined, strict=True), key=lambda one: -one[0]):
            if len(ranked) < config.correlation.finalists and all(_elsewhere(motion, m, centre) for _, m in ranked):
                ranked.append((support, motion))
    return ranked


def _elsewhere(motion: SE2, other: SE2, centre: FloatArray) -> bool:
    """Tell whether two alignments put the source at different places."""
    apart = np.linalg.norm(motion.apply(centre) - other.apply(centre))
    return bool(apart > _ELSEWHERE_M or abs(wrap_angle(motion.theta - other.theta)) > _ELSEWHERE_RAD)


def _judged(found: Alignment, motion: SE2, target: Structure, source: Structure, config: MergeConfig) -> Alignment:
    """Accept what was found where the walls confirm it; where they do not, the reason is theirs."""
    evidence = examine(target, source, motion, config.verification)
    against = objection(evidence, config.verification)
    confirmed = f"{found.reason}; {evidence.agreed_wall_m:.1f} m of wall confirm it ({evidence.agreement:.0%})"
    if found.method == "correlation":  # whose matches are the walls themselves
        step = target.geometry.resolution
        walls = round(evidence.compared_wall_m / step), round(evidence.agreed_wall_m / step)
        found = replace(found, matches=walls[0], inliers=walls[1], rmse_m=evidence.rmse_m)
    return replace(
        found,
        accepted=against is None,
        reason=confirmed if against is None else against,
        T_target_source=motion,
        overlap_m2=evidence.overlap_m2,
        agreement=evidence.agreement,
        conflict=evidence.conflict,
        agreed_wall_m=evidence.agreed_wall_m,
        weakest_wall_m=evidence.weakest_wall_m,
    )
