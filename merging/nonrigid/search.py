"""Another look at two maps that fit nowhere as they are: one of them bent at the places that look best from afar.

The correlation on coarse cells, which forgives some tenths of a metre, finds where bent maps lie; only the judgement
that follows refuses them. But what may be bent fits more places. So the bent map must be aligned there once more as a
whole, as if nobody had said where, and stand out among rivals that were bent as well: other places, and places of its
mirror image.
"""

import math
from dataclasses import dataclass, replace

from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.fusion.warping import at_resolution
from merging.map_graph.hypothesis import is_same_place
from merging.nonrigid.deformation import Deformation
from merging.nonrigid.rivals import DeformedRivals, first_apart
from merging.nonrigid.tile_registration import DeformableMap, DeformedMap, deform
from merging.registration.correlation import propose
from merging.rigid_alignment import align_whole, comparison_resolution
from merging.scoring.confidence import confidences
from merging.verification.covariance import bent_by
from merging.walls.wall_map import WallMap, without_walls
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap


@dataclass(frozen=True)
class NonrigidRegistration:
    """Two maps of which one fits the other once it is bent.

    Parameters
    ----------
    alignment
        Where the source lies in the target's frame as nearly as a rigid motion can tell, accepted; its evidence is that
        of the bent map.
    bend
        How the source is bent, seen from the target.
    """

    alignment: Alignment
    bend: Deformation


def register_nonrigid(target: TbmMap, source: TbmMap, config: MergeConfig) -> NonrigidRegistration | None:
    """Find where a source map lies in a target map's frame once one of them is bent; None where nobody can tell.

    Parameters
    ----------
    target, source
        The maps; the one with less wall is bent, whichever it is.
    config
        How it is bent and believed.
    """
    both = target, source
    wanted = config.nonrigid.enabled and config.method == "correlation"
    if not (wanted and all(one.grid.is_known().any() for one in both)):
        return None
    resolution = comparison_resolution([one.grid for one in both], config)
    grids = [at_resolution(one.grid, resolution) for one in both]
    structures = [WallMap.from_grid(grid, config.structure) for grid in grids]
    if without_walls(*structures):
        return None
    moving = 0 if structures[0].wall_m < structures[1].wall_m else 1  # who is named first must not matter
    source_map = DeformableMap.of(grids[moving], config, structures[moving])
    found = _bent_onto(grids[1 - moving], structures[1 - moving], source_map, config)
    return (
        found
        if found is None or moving == 1
        else NonrigidRegistration(found.alignment.reversed(), found.bend.inverse())
    )


def _bent_onto(
    target: TbmGrid, fixed: WallMap, source: DeformableMap, config: MergeConfig
) -> NonrigidRegistration | None:
    """Deform a map at the places that look best, until it is aligned at one."""
    proposals = propose(fixed, source.structure, config.correlation)
    for place in first_apart(proposals, source.structure, config.nonrigid.places):
        laid = deform(fixed, source, place, config)
        if laid is None:
            continue
        again = align_whole(TbmMap(target), TbmMap(laid.grid), config)
        if not _is_aligned(again, laid.motion, config):
            continue
        among = DeformedRivals.of(fixed, source, laid.motion, proposals, config)
        confidence = confidences(among.evidence, among.decoys)[0]
        return (
            NonrigidRegistration(_answer(again, laid, confidence), laid.bend) if confidence >= _limit(config) else None
        )
    return None


def _limit(config: MergeConfig) -> float:
    return config.verification.min_confidence


def _is_aligned(found: Alignment, there: SE2, config: MergeConfig) -> bool:
    where = found.T_target_source
    return found.accepted and where is not None and is_same_place(there, where, config.graph, found.covariance)


def _answer(again: Alignment, laid: DeformedMap, confidence: float) -> Alignment:
    bent = f"bent by {laid.apart_m:.2f} m and {math.degrees(laid.apart_rad):.1f} degrees one map fits the other"
    return replace(
        again,
        reason=f"{bent}: confidence {confidence:.3f} among rivals bent as well; straightened: {again.reason}",
        T_target_source=laid.motion,
        bent_m=laid.apart_m,
        confidence=confidence,
        covariance=again.covariance and bent_by(again.covariance, laid.apart_m, laid.apart_rad),
        alternatives=(),
    )
