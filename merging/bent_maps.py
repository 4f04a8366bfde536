"""Maps that fit nowhere as a whole, since they bent while they were made: laid in stretches, straightened, tried again.

What was left out is cut into stretches of its drives, and each is aligned with the merged map of the others. Where
several agree on a place, all drives are straightened together there. The place counts if the two maps, straight now,
are aligned with each other there without being told.
"""

import itertools
import logging
from collections.abc import Collection
from dataclasses import dataclass, replace

from merging.aligner import align_whole
from merging.alignment import Alignment, Pair
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.exactness import seen_from
from merging.findings import Findings
from merging.joint_refinement import JointRefinement, nearest_rigid, refine_jointly
from merging.merged_group import MergedGroup
from merging.offers import is_same_place
from merging.redrawing import redraw
from merging.stretches import elect, laid_in_stretches, stretches_of
from merging.workforce import Workforce
from tbmslam.grid import TbmGrid
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap

logger = logging.getLogger(__name__)

_TARGET, _SOURCE = "target", "source"


@dataclass(frozen=True)
class BentMap:
    """A map that was placed in stretches.

    Parameters
    ----------
    alignment
        Where it lies in the target's frame as nearly as a rigid motion can tell, accepted; its evidence is that of the
        straightened maps.
    straightened
        The map, in its own frame, bent so that its stretches lie where they were found.
    grids
        The grids of target and source, each in its own frame, straightened together: what the alignment was judged by.
    """

    alignment: Alignment
    straightened: TbmMap
    grids: tuple[TbmGrid, TbmGrid]


def place_bent_map(
    known: Findings,
    joined: MergedGroup | None,
    config: MergeConfig,
    workforce: Workforce,
    placed: Collection[Pair] = (),
) -> tuple[Pair, BentMap] | None:
    """Place one of the maps left out so far, and say on which map; None where none can be placed.

    Parameters
    ----------
    known
        The maps, and what is known of them so far.
    joined
        The first group as one map; None where no two maps were joined, and each is tried on each.
    config
        How stretches are cut and believed.
    workforce
        Who aligns them.
    placed
        What was returned before. Where that joined no maps, since too much else spoke against it, it would not again.

    Returns
    -------
    The names of the map tried on, or of the first in its group, and of the one placed.
    """
    if not (config.stretches.enabled and config.joint.enabled and config.method == "correlation"):
        return None
    maps = known.maps
    if joined is not None:
        tries = [(known.groups[0].first, joined.merged, name) for name in maps if name not in joined.poses]
    else:
        tries = [(target, maps[target], source) for target, source in itertools.combinations(maps, 2)]
    for base, target, name in tries:
        if (base, name) in placed:
            continue
        found = place_bent(target, maps[name], config, workforce)
        if found is not None:
            onto = "" if joined is None else f"onto {len(joined.poses)} maps merged so far: "
            alignment = replace(found.alignment, reason=onto + found.alignment.reason)
            logger.info("%s in %s: %s", name, base, alignment.reason)
            return (base, name), replace(found, alignment=alignment)
    return None


def place_bent(
    target: TbmMap,
    source: TbmMap,
    config: MergeConfig,
    workforce: Workforce | None = None,
) -> BentMap | None:
    """Find where a source map lies in a target map's frame by stretches of its drives; None where nobody can tell."""
    if not (_is_driven(target) and _is_driven(source)):
        return None
    workforce = workforce or Workforce()
    stretches = stretches_of(source, config.stretches)
    if len(stretches) < 2:
        return None
    pieces = {f"stretch {index}": stretch.map for index, stretch in enumerate(stretches, 1)}
    pairs = [(_TARGET, name) for name in pieces]
    found = align_all({_TARGET: target, **pieces}, config, workforce, pairs)
    place = elect(stretches, list(found.values()), config.graph, config.stretches)
    if place is None:
        return None
    laid = laid_in_stretches(source, stretches, place)
    told = f"laid in stretches of the drive, {len(place.motions)} of {len(stretches)} of which agree"
    joint = refine_jointly(*_where_laid(target, laid), config.joint, workforce.watch)
    again = _aligned_again(joint, config)
    if joint is None or not again.accepted:
        logger.info("%s, but %s", told, again.reason)
        return None
    motion = nearest_rigid(source, laid)
    straightened, judged = (_moved_back(one, motion) for one in (laid, joint.maps[_SOURCE]))
    reason = f"{told}; straightened: {again.reason}"
    covariance = None if again.covariance is None else seen_from(again.covariance, motion.inverse())
    alignment = replace(again, reason=reason, T_target_source=motion, covariance=covariance, alternatives=())
    return BentMap(alignment, straightened, (joint.maps[_TARGET].grid, judged.grid))


def _moved_back(one: TbmMap, T_target_source: SE2) -> TbmMap:
    """Return a map that lies in the target's frame in the source's."""
    back = T_target_source.inverse()
    return one.moved(back, redraw([drive.transformed(back).keyframes for drive in one.drives], one))


def _is_driven(one: TbmMap) -> bool:
    return bool(one.drives) and all(len(drive.keyframes) > 1 for drive in one.drives)


def _where_laid(target: TbmMap, laid: TbmMap) -> tuple[dict[str, TbmMap], dict[str, SE2]]:
    """Return two maps by name, and that each lies where it is."""
    return {_TARGET: target, _SOURCE: laid}, {_TARGET: SE2.identity(), _SOURCE: SE2.identity()}


def _aligned_again(joint: JointRefinement | None, config: MergeConfig) -> Alignment:
    """Align two maps that were straightened where one is thought to lie; elsewhere is a refusal."""
    if joint is None:
        return Alignment("correlation", accepted=False, reason="the drives cannot be straightened together there")
    found = align_whole(joint.maps[_TARGET], joint.maps[_SOURCE], config)
    where = found.T_target_source
    if found.accepted and (where is None or not is_same_place(SE2.identity(), where, config.graph, found.covariance)):
        return replace(found, accepted=False, reason="straightened there, the maps are aligned elsewhere")
    return found
