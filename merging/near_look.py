"""A second look at maps that no alignment joined: at what their robots saw from near by.

The farther off a wall was seen, the farther it may lie from where it is drawn, and at a grazing angle it is hardly
drawn at all: glimpses along corridors contradict another map even where the two belong together. Where maps carry
keyframes, their grids are drawn once more from near hits alone and aligned anew, as if nobody had looked before.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from merging.alignment import Alignment, Pair
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.map_graph import Group
from merging.near_drives import NearPair, align_by_drives, redraw_near
from tbmslam.grid import TbmGrid
from tbmslam.tbm_map import TbmMap
from tbmslam.watch import Watch


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
    maps: Mapping[str, TbmMap],
    groups: Sequence[Group],
    alignments: Mapping[Pair, Alignment],
    config: MergeConfig,
    workers: int = 1,
    watch: Watch | None = None,
    scheduler: str | None = None,
) -> NearLook:
    """Align the maps of different groups once more, by what was seen from near by.

    Parameters
    ----------
    maps
        All maps, by name.
    groups
        What was joined so far.
    alignments
        What the first look found.
    config
        What is near, and how maps are aligned.
    workers, watch, scheduler
        See `merging.all_pairs.align_all`.
    """
    where = {name: number for number, group in enumerate(groups) for name in group.poses}
    pairs = [
        pair
        for pair in itertools.combinations(maps, 2)
        if where[pair[0]] != where[pair[1]] and all(maps[name].drives for name in pair)
    ]
    if not (pairs and config.near.enabled and config.method == "correlation"):
        return NearLook({}, {})
    wanted = {name for pair in pairs for name in pair}
    near = {name: redraw_near(one, config.near.range_m) for name, one in maps.items() if name in wanted}
    found = align_all({name: TbmMap(grid) for name, grid in near.items()}, config, workers, watch, scheduler, pairs)
    looks = {pair: NearPair(one, (near[pair[0]], near[pair[1]])) for pair, one in found.items()}
    refused = [pair for pair in pairs if not found[pair].accepted]
    looks |= align_by_drives(maps, refused, config, workers, watch, scheduler)
    surer = {pair: one for pair, one in looks.items() if one.alignment.confidence > alignments[pair].confidence}
    told = f"by what was seen within {config.near.range_m:g} m"
    return NearLook(
        {pair: replace(one.alignment, reason=f"{told}: {one.alignment.reason}") for pair, one in surer.items()},
        {pair: one.grids for pair, one in surer.items()},
    )
