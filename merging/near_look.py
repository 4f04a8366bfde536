"""A second look at maps that no alignment joined: at what their robots saw from near by.

The farther off a wall was seen, the farther it may lie from where it is drawn, and at a grazing angle it is hardly
drawn at all: glimpses along corridors contradict another map even where the two belong together. Where maps carry
keyframes, their grids are drawn once more from near hits alone and aligned anew, as if nobody had looked before.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from merging.alignment import Alignment, Pair
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.findings import Findings
from merging.near_drives import NearPair, align_by_drives, redraw_near
from merging.workforce import Workforce
from tbmslam.grid import TbmGrid
from tbmslam.tbm_map import TbmMap


@dataclass(frozen=True)
class NearLook:
    """What the second look found.

    Parameters
    ----------
    alignments
        Of the pairs that it is surer of than the first.
    grids
        What of target and source each of these was judged by, in their frames.
    """

    alignments: Mapping[Pair, Alignment]
    grids: Mapping[Pair, tuple[TbmGrid, TbmGrid]]


def look_near(
    found: Findings,
    config: MergeConfig,
    workforce: Workforce,
) -> NearLook:
    """Align the maps of different groups once more, by what was seen from near by.

    Parameters
    ----------
    found
        The maps, and what is known of them so far.
    config
        What is near, and how maps are aligned.
    workforce
        Who aligns them.
    """
    maps = found.maps
    pairs = [pair for pair in found.apart() if all(maps[name].drives for name in pair)]
    if not (pairs and config.near.enabled and config.method == "correlation"):
        return NearLook({}, {})
    wanted = {name for pair in pairs for name in pair}
    near = {name: redraw_near(one, config.near.range_m) for name, one in maps.items() if name in wanted}
    again = align_all({name: TbmMap(grid) for name, grid in near.items()}, config, workforce, pairs)
    looks = {pair: NearPair(one, (near[pair[0]], near[pair[1]])) for pair, one in again.items()}
    refused = [pair for pair in pairs if not again[pair].accepted]
    looks |= align_by_drives(maps, refused, config, workforce)
    surer = {pair: one for pair, one in looks.items() if one.alignment.confidence > found.alignments[pair].confidence}
    told = f"by what was seen within {config.near.range_m:g} m"
    return NearLook(
        {pair: replace(one.alignment, reason=f"{told}: {one.alignment.reason}") for pair, one in surer.items()},
        {pair: one.grids for pair, one in surer.items()},
    )
