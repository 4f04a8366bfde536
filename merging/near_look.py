"""A second look at maps that no alignment joined: at what their robots saw from near by.

The farther off a wall was seen, the farther it may lie from where it is drawn, and at a grazing angle it is hardly
drawn at all: glimpses along corridors contradict another map even where the two belong together. Where maps carry
keyframes, their grids are drawn once more from near hits alone and aligned anew, as if nobody had looked before.
"""

import itertools
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from merging.alignment import Alignment, Pair
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.map_graph import Group
from merging.redrawing import redraw
from tbmslam.grid import TbmGrid
from tbmslam.tbm_map import TbmMap
from tbmslam.watch import Watch

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class NearLook:
    """What the second look found.

    Parameters
    ----------
    alignments
        Of the pairs that it is surer of than the first.
    grids
        What was looked at, of every map that it was drawn for.
    """

    alignments: Mapping[Pair, Alignment]
    grids: Mapping[str, TbmGrid]


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
    surer = {
        pair: replace(one, reason=f"by what was seen within {config.near.range_m:g} m: {one.reason}")
        for pair, one in found.items()
        if one.confidence > alignments[pair].confidence
    }
    return NearLook(surer, near)


def redraw_near(one: TbmMap, range_m: float) -> TbmGrid:
    """Return a map's grid without the hits beyond a range [m]."""
    return redraw([drive.keyframes for drive in one.drives], one, range_m)
