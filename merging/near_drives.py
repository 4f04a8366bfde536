"""Maps as drives saw them from near by; a merged map takes part in a merge as the drives that it was made of.

The more robots saw of a building, the more of what one of them glimpsed contradicts another's map. Its drives one by
one do as their maps would have done if all had been merged at once: what several put to one place is believed.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from merging.alignment import Alignment
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.map_graph import join
from merging.offers import is_same_place, offers_of
from merging.redrawing import redraw
from tbmslam.grid import TbmGrid
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap
from tbmslam.watch import Watch


@dataclass(frozen=True)
class NearPair:
    """Two maps aligned by what was seen from near by.

    Parameters
    ----------
    alignment
        What was found.
    grids
        What of target and source it was judged by, in their frames.
    """

    alignment: Alignment
    grids: tuple[TbmGrid, TbmGrid]


def redraw_near(one: TbmMap, range_m: float) -> TbmGrid:
    """Return a map's grid without the hits beyond a range [m]."""
    return redraw([drive.keyframes for drive in one.drives], one, range_m)


def align_by_drives(
    target: TbmMap,
    source: TbmMap,
    config: MergeConfig,
    workers: int = 1,
    watch: Watch | None = None,
    scheduler: str | None = None,
) -> NearPair | None:
    """Align each drive of a map with each of another; None where these are one pair, or do not agree on a place.

    Nor is a place that is an alternative only, and the best of no pair: of it no pair's evidence tells.

    See `merging.all_pairs.align_all` for `workers`, `watch` and `scheduler`.
    """
    drives = [_near_drives(one, name, config) for one, name in ((target, "target"), (source, "source"))]
    pairs = list(itertools.product(drives[0], drives[1]))
    if len(pairs) < 2:
        return None
    parts = {name: TbmMap(grid) for grids in drives for name, grid in grids.items()}
    found = align_all(parts, config, workers, watch, scheduler, pairs)
    first, second = (dict.fromkeys(grids, SE2.identity()) for grids in drives)
    joint = join(first, second, found, config.graph)
    if joint is None:
        return None
    place, odds = joint
    agreeing = {pair: one for pair, one in found.items() if _leads_to(place, one, config)}
    if not agreeing:
        return None
    others = [offers_of(pair, one, config.graph) for pair, one in found.items() if pair not in agreeing]
    also = sum(any(is_same_place(place, offer.motion, config.graph) for offer in offers) for offers in others)
    more = f", {also} more by an alternative" if also else ""
    surest = max(agreeing, key=lambda pair: agreeing[pair].confidence)
    alignment = replace(
        agreeing[surest],
        accepted=True,
        ambiguous=False,
        confidence=1.0 / (1.0 + math.exp(-odds)),
        reason=f"{len(agreeing)} of {len(pairs)} pairs of drives agree{more}, the surest with {found[surest].reason}",
        T_target_source=place,
        alternatives=(),
    )
    return NearPair(alignment, (drives[0][surest[0]], drives[1][surest[1]]))


def _near_drives(one: TbmMap, name: str, config: MergeConfig) -> Mapping[str, TbmGrid]:
    """Return the grid of every drive of a map, by a name for it."""
    return {
        f"{name}, drive {number}": redraw([drive.keyframes], one, config.near.range_m)
        for number, drive in enumerate(one.drives, 1)
    }


def _leads_to(place: SE2, found: Alignment, config: MergeConfig) -> bool:
    return found.T_target_source is not None and is_same_place(place, found.T_target_source, config.graph)
