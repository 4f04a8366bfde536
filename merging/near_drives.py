"""Maps as drives saw them from near by; a merged map takes part in a merge as the drives that it was made of.

The more robots saw of a building, the more of what one of them glimpsed contradicts another's map. Its drives one by
one do as their maps would have done if all had been merged at once: what several put to one place is believed.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from merging.alignment import Alignment, Pair
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.map_graph import join
from merging.offers import is_same_place, offers_of
from merging.redrawing import redraw
from merging.workforce import Workforce
from tbmslam.grid import TbmGrid
from tbmslam.keyframes import Keyframes
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap


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
    maps: Mapping[str, TbmMap],
    pairs: Sequence[Pair],
    config: MergeConfig,
    workforce: Workforce | None = None,
) -> dict[Pair, NearPair]:
    """Align each drive of a map with each of another; return the pairs of maps whose drives agree on a place.

    Maps of one drive each are no two pairs of drives, and are left out. So is a place that is an alternative only, and
    the best of no pair: of it no pair's evidence tells.

    Parameters
    ----------
    maps
        Maps by name.
    pairs
        The pairs wanted.
    config
        What is near, and how drives are aligned.
    workforce
        See `merging.all_pairs.align_all`.
    """
    drives = {name: _named_drives(name, maps[name]) for name in dict.fromkeys(itertools.chain(*pairs))}
    among = {pair: list(itertools.product(drives[pair[0]], drives[pair[1]])) for pair in pairs}
    among = {pair: ones for pair, ones in among.items() if len(ones) > 1}
    grids = {
        drive: redraw([keyframes], maps[name], config.near.range_m)
        for name in dict.fromkeys(itertools.chain(*among))
        for drive, keyframes in drives[name].items()
    }
    parts = {drive: TbmMap(grid) for drive, grid in grids.items()}
    found = align_all(parts, config, workforce, list(itertools.chain(*among.values())))
    looks = {pair: _agreed({one: found[one] for one in ones}, grids, config) for pair, ones in among.items()}
    return {pair: look for pair, look in looks.items() if look is not None}


def _agreed(found: Mapping[Pair, Alignment], grids: Mapping[str, TbmGrid], config: MergeConfig) -> NearPair | None:
    """Return the place that the drives of two maps agree on; None if they agree on none."""
    first, second = (dict.fromkeys(names, SE2.identity()) for names in zip(*found, strict=True))
    joint = join(first, second, found, config.graph)
    if joint is None:
        return None
    place, odds = joint
    agreeing = {pair: one for pair, one in found.items() if _leads_to(place, one, config)}
    if not agreeing:
        return None
    others = [offers_of(pair, one, config.graph) for pair, one in found.items() if pair not in agreeing]
    also = sum(
        any(is_same_place(place, offer.motion, config.graph, offer.covariance) for offer in offers) for offers in others
    )
    more = f", {also} more by an alternative" if also else ""
    surest = max(agreeing, key=lambda pair: agreeing[pair].confidence)
    alignment = replace(
        agreeing[surest],
        accepted=True,
        ambiguous=False,
        confidence=1.0 / (1.0 + math.exp(-odds)),
        reason=f"{len(agreeing)} of {len(found)} pairs of drives agree{more}, the surest with {found[surest].reason}",
        alternatives=(),
    )
    return NearPair(alignment, (grids[surest[0]], grids[surest[1]]))


def _named_drives(name: str, one: TbmMap) -> dict[str, Keyframes]:
    """Return the keyframes of every drive of a map, by a name for it."""
    return {f"{name}, drive {number}": drive.keyframes for number, drive in enumerate(one.drives, 1)}


def _leads_to(place: SE2, found: Alignment, config: MergeConfig) -> bool:
    motion = found.T_target_source
    return motion is not None and is_same_place(place, motion, config.graph, found.covariance)
