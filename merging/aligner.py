"""Two maps, and where one lies in the other's frame."""

from dataclasses import dataclass, replace

from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.consensus import find_consensus
from merging.features import Features, describe, match
from merging.refinement import refine
from merging.structure import Structure
from merging.verification import examine, objection
from merging.warping import at_resolution
from tbmslam.grid import TbmGrid
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap


@dataclass(frozen=True)
class View:
    """One map as the aligner looks at it, so that a map met by many others is looked at once.

    Parameters
    ----------
    structure
        Its walls and free space.
    features
        Its keypoints.
    """

    structure: Structure
    features: Features


def view_of(grid: TbmGrid, resolution: float, config: MergeConfig) -> View | None:
    """Look at a grid in cells of the given size [m]; None where nothing in it is known."""
    if not grid.is_known().any():
        return None
    seen = at_resolution(grid, resolution)
    return View(Structure.from_grid(seen, config.structure), describe(seen, config.features))


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
    return _by_features(target, source, config)


def _by_features(target: View, source: View, config: MergeConfig) -> Alignment:
    """Align by keypoints (the paper, section IV), then let the walls confirm it."""
    matches = match(target.features, source.features, config.features)
    consensus = find_consensus(matches, config.consensus)
    refused = Alignment("features", accepted=False, reason="", matches=len(matches))
    if consensus is not None:
        refused = replace(
            refused,
            T_target_source=consensus.T_target_source,
            inliers=consensus.count,
            rmse_m=consensus.rmse_m,
            scale=consensus.scale,
        )
    if consensus is None or consensus.count < config.consensus.min_inliers:
        among = f"{len(matches)} matches of {len(target.features)} and {len(source.features)} keypoints"
        reason = f"only {refused.inliers} inliers among {among}, fewer than {config.consensus.min_inliers}"
        return replace(refused, reason=reason)
    if not abs(consensus.scale - 1.0) <= config.consensus.max_scale_deviation:
        reason = (
            f"the {consensus.count} inliers fit best at a scale of {consensus.scale:.3f}, farther from 1 than "
            f"{config.consensus.max_scale_deviation:g}: is the resolution of a map wrong?"
        )
        return replace(refused, reason=reason)
    found = replace(refused, reason=f"{consensus.count} of {len(matches)} matches agree")
    motion = refine(target.structure, source.structure, consensus.T_target_source, config.refinement)
    return _judged(found, motion, target, source, config)


def _judged(found: Alignment, motion: SE2, target: View, source: View, config: MergeConfig) -> Alignment:
    """Accept what was found where the walls confirm it; its reason becomes theirs where they do not."""
    evidence = examine(target.structure, source.structure, motion, config.verification)
    against = objection(evidence, config.verification)
    confirmed = f"{found.reason}; {evidence.agreed_wall_m:.1f} m of wall confirm it ({evidence.agreement:.0%})"
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
