"""Non-rigid registration of two maps: one of them is deformed at the best poses of the correlation.

The correlation works on coarse cells and tolerates some tenths of a metre, so it finds deformed maps too; only the
verification refuses them. A deformed map fits more poses than a rigid one. Therefore the deformed map must pass a new
rigid alignment without an initial guess, and must stand out among rivals that were deformed as well: other poses of the
map, and poses of its mirror image. Tiles leave some distance between walls that belong together. Where the correlation
leaves no doubt about the place, a second attempt bears with more of it.
"""

import itertools
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from merging.alignment import Alignment, Pair, format_confidence
from merging.config import MergeConfig
from merging.fusion.warping import at_resolution
from merging.map_graph.hypothesis import is_same_pose
from merging.merge_state import MergeState
from merging.nonrigid.deformation import Deformation
from merging.nonrigid.tile_registration import DeformableMap, DeformedMap, deform
from merging.pairwise import CompressedGrid, most_held
from merging.registration.correlation import Proposals, propose
from merging.registration.hypotheses import best_of, elsewhere, lead_of, refine_all
from merging.rigid_alignment import align_whole, comparison_resolution
from merging.scoring.confidence import confidences
from merging.scoring.decoys import mirrored
from merging.verification.covariance import bent_by
from merging.verification.evidence import Evidence, examine
from merging.walls.wall_map import WallMap, without_walls
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

logger = logging.getLogger(__name__)


_HELD_CELLS = 1.6e7
"""Maps in tiles take 60 bytes a cell: a process holds 1 GB of them."""
_OTHER_SCALE = 0.01
"""A scale nearer to 1 than this may be the error of the tiles: cells of 5 cm over tiles of some metres."""
_MOSTLY = 0.5
"""A scale that explains more of the bend than this is told."""


@dataclass(frozen=True)
class DeformedRivals:
    """What speaks for and against each place once the map is bent to fit there.

    Parameters
    ----------
    motions
        T_target_source (K,), roughly; of the place in question first.
    evidence
        Of each of them (K,).
    decoys
        Of places of the mirror image (D,).
    """

    motions: Sequence[SE2]
    evidence: Sequence[Evidence]
    decoys: Sequence[Evidence]

    @classmethod
    def of(
        cls, target: WallMap, source: DeformableMap, place: SE2, proposals: list[SE2], config: MergeConfig
    ) -> "DeformedRivals":
        """Deform a map at a place, at its rivals, and its mirror image at its own.

        Parameters
        ----------
        target
            The other map.
        source
            The map.
        place
            The place in question, T_target_source.
        proposals
            Places of the source, the best from afar first.
        config
            How maps are bent, and what is looked at.
        """
        mirror = DeformableMap.of(mirrored(source.grid), config)
        decoys = _rivals(target, mirror, propose(target, mirror.structure, config.correlation).motions, config)
        places = [place, *_rivals(target, source, proposals, config)]
        motions = first_apart(places, source.structure, len(places))
        own, others = (
            [_evidence(target, one, motion, config) for motion in some]
            for one, some in ((source, motions), (mirror, decoys))
        )
        return cls(motions, own, others)


def first_apart(places: list[SE2], source: WallMap, count: int) -> list[SE2]:
    """Return so many of the first places, none near a better one."""
    return elsewhere(places, -np.arange(len(places), dtype=np.float64), source, count)


def _rivals(target: WallMap, source: DeformableMap, proposals: list[SE2], config: MergeConfig) -> list[SE2]:
    """Return the places that look best from afar, and those that fit best as they are."""
    fitting = [place for place, _ in best_of(proposals, target, source.structure, config)]
    some = [*first_apart(proposals, source.structure, config.nonrigid.rivals), *fitting[: config.nonrigid.rivals]]
    return first_apart(some, source.structure, len(some))


def _evidence(target: WallMap, source: DeformableMap, place: SE2, config: MergeConfig) -> Evidence:
    """Return what speaks for and against a place once the map is bent to fit there; as it is where it cannot be."""
    bent = deform(target, source, place, config)
    structure = source.structure if bent is None else WallMap.from_grid(bent.grid, config.structure)
    motion = refine_all(target, structure, [place if bent is None else bent.motion], config)[0]
    return examine(target, structure, motion, config.verification)


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


class Peak(NamedTuple):
    """The best place of a correlation.

    Parameters
    ----------
    motion
        Where the map with less wall lies in the other's frame, `Alignment.T_more_less`.
    lead
        Its score over that of the best place elsewhere.
    """

    motion: SE2
    lead: float


def register_nonrigid(target: TbmMap, source: TbmMap, config: MergeConfig) -> NonrigidRegistration | None:
    """Find where a source map lies in a target map's frame once one of them is bent; None where nobody can tell.

    Parameters
    ----------
    target, source
        The maps; the one with less wall is bent, whichever it is.
    config
        How it is bent and believed.
    """
    if not (config.nonrigid.enabled and config.method == "correlation"):
        return None
    resolution = comparison_resolution([target.grid, source.grid], config)
    fixed, moving = (deformable(one.grid, resolution, config) for one in (target, source))
    return register_deformable(fixed, moving, config)


def deformable(grid: TbmGrid, resolution: float, config: MergeConfig) -> DeformableMap | None:
    """Look at a grid in cells of the given size [m]; None where nothing in it is known."""
    return DeformableMap.of(at_resolution(grid, resolution), config) if grid.is_known().any() else None


def register_deformable(
    target: DeformableMap | None, source: DeformableMap | None, config: MergeConfig, peak: Peak | None = None
) -> NonrigidRegistration | None:
    """Do the same with two maps in cells of one size, None where nothing is known of one.

    `peak` is that of the correlation; it is sought where it is not given.
    """
    if target is None or source is None or without_walls(target.structure, source.structure):
        return None
    if target.structure.wall_m < source.structure.wall_m:  # who is named first must not matter
        found = _bent_onto(source, target, peak, config)
        return found and NonrigidRegistration(found.alignment.reversed(), found.bend.inverse())
    return _bent_onto(target, source, peak, config)


def _bent_onto(
    target: DeformableMap, source: DeformableMap, peak: Peak | None, config: MergeConfig
) -> NonrigidRegistration | None:
    """Deform a map at the places that look best, until it is aligned at one."""
    fixed = target.structure
    proposals = lru_cache(lambda: propose(fixed, source.structure, config.correlation))  # most need none
    if peak is not None:
        places, lead = [peak.motion], peak.lead
    else:
        places = first_apart(proposals().motions, source.structure, config.nonrigid.places)
        lead = lead_of(proposals(), source.structure)
    found = _bent_at(target, source, places, proposals, config)
    if found is None and lead >= config.nonrigid.clear_lead:
        found = _bent_at(target, source, places, proposals, _widened(config))
    return found


def _bent_at(
    target: DeformableMap,
    source: DeformableMap,
    places: Sequence[SE2],
    proposals: Callable[[], Proposals],
    config: MergeConfig,
) -> NonrigidRegistration | None:
    fixed = target.structure
    for place in places:
        laid = deform(fixed, source, place, config)
        if laid is None:
            continue
        again = align_whole(TbmMap(target.grid), TbmMap(laid.grid), config)
        if not _is_aligned(again, laid.motion, config):
            continue
        among = DeformedRivals.of(fixed, source, laid.motion, proposals().motions, config)
        confidence = confidences(among.evidence, among.decoys)[0]
        return (
            NonrigidRegistration(_answer(again, laid, confidence), laid.bend) if confidence >= _limit(config) else None
        )
    return None


def _widened(config: MergeConfig) -> MergeConfig:
    """Return how maps are bent and believed where walls that belong together may lie farther apart."""
    how = config.nonrigid
    distances = {
        "agreement_distance_m": how.wide_agreement_m,
        "conflict_distance_m": how.wide_conflict_m,
        "see_through_m": how.wide_see_through_m,
    }
    return config.model_copy(
        update={
            "verification": config.verification.model_copy(update=distances),
            "refinement": config.refinement.model_copy(update={"last_reach_m": how.wide_agreement_m}),
        }
    )


def _limit(config: MergeConfig) -> float:
    return config.verification.min_confidence


def _is_aligned(found: Alignment, there: SE2, config: MergeConfig) -> bool:
    where = found.T_target_source
    return found.accepted and where is not None and is_same_pose(there, where, config.graph, found.covariance)


def _other_scale(bend: Deformation) -> float | None:
    """Return by what a map is too small where a scale is most of how it is bent; else None."""
    scale, share = bend.scale()
    return scale if abs(scale - 1.0) > _OTHER_SCALE and share > _MOSTLY else None


def _answer(again: Alignment, laid: DeformedMap, confidence: float) -> Alignment:
    bent = f"bent by {laid.apart_m:.2f} m and {math.degrees(laid.apart_rad):.1f} degrees one map fits the other"
    if (scale := _other_scale(laid.bend)) is not None:
        larger = 100.0 * (max(scale, 1.0 / scale) - 1.0)
        bent += f", mostly as one is {larger:.1f} % larger: is the resolution of a map wrong?"
    return replace(
        again,
        reason=f"{bent}: confidence {format_confidence(confidence)} among rivals bent as well; "
        f"straightened: {again.reason}",
        T_target_source=laid.motion,
        bent_m=laid.apart_m,
        confidence=confidence,
        covariance=again.covariance and bent_by(again.covariance, laid.apart_m, laid.apart_rad),
        alternatives=(),
    )


def may_be_deformed(refused: Alignment, config: MergeConfig) -> bool:
    """Tell whether a pair may show one place, if it was refused: whether one place stands out in the correlation.

    The correlation bears with some tenths of a metre, so that the true place of a deformed map stands out in it.
    """
    return not refused.accepted and refused.lead >= config.nonrigid.min_lead


def register_refused_pairs(
    found: MergeState,
    config: MergeConfig,
    executor: Executor,
) -> dict[Pair, NonrigidRegistration]:
    """Look at refused pairs of different groups, one of each two maps bent; return those that were aligned so.

    Parameters
    ----------
    found
        The maps, and what is known of them so far.
    config
        How maps are bent and believed.
    executor
        Who bends them.
    """
    pairs = [pair for pair in found.apart() if may_be_deformed(found.alignments[pair], config)]
    if not (pairs and config.nonrigid.enabled and config.method == "correlation"):
        return {}
    grids = {name: one.grid for name, one in found.maps.items()}
    sizes = {pair: comparison_resolution([grids[name] for name in pair], config) for pair in pairs}
    sent = {name: CompressedGrid(grids[name]) for name in dict.fromkeys(itertools.chain.from_iterable(pairs))}
    maps = {
        (name, size): Call(f"map {name} {size}", _deformable, (sent[name], size, config))
        for pair, size in sizes.items()
        for name in pair
    }
    calls = [
        Call(
            f"{source} bent in {target}",
            register_deformable,
            (maps[target, size], maps[source, size], config, _peak_of(found, (target, source), config)),
        )
        for (target, source), size in sizes.items()
    ]
    looks: list[NonrigidRegistration | None] = executor.results(
        calls, "bending", "pairs", most_held((grids[name] for name in sent), _HELD_CELLS)
    )
    joins = {pair: look for pair, look in zip(pairs, looks, strict=True) if look is not None}
    for (target, source), look in joins.items():
        logger.info("%s in %s: accepted: %s", source, target, look.alignment.reason)
        if (scale := _other_scale(look.bend)) is not None:
            which, other = (target, source) if scale > 1.0 else (source, target)
            logger.warning(
                "%s is %.1f %% larger than %s: correct the resolution of the one that is wrong",
                which,
                100.0 * (max(scale, 1.0 / scale) - 1.0),
                other,
            )
    return joins


def _deformable(sent: CompressedGrid, resolution: float, config: MergeConfig) -> DeformableMap | None:
    return deformable(sent.grid, resolution, config)


def _peak_of(found: MergeState, pair: Pair, config: MergeConfig) -> Peak | None:
    """Return the peak of a pair's correlation; None where more places are wanted, or those of other grids."""
    refused = found.alignments[pair]
    if refused.T_more_less is None or pair in found.evidence_grids or config.nonrigid.places > 1:
        return None
    return Peak(refused.T_more_less, refused.lead)
