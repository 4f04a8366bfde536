"""A second registration of maps that no alignment joined: by what their robots saw at short range.

The farther off a wall was seen, the farther it may lie from where it is drawn, and at a grazing angle it is hardly
drawn at all: glimpses along corridors contradict another map even where the two belong together. Where maps carry
keyframes, their grids are rendered again from short ranges only and aligned as if for the first time.

Without it one map of the recording ACES, cut into 8 robots and cut into 10, stays out of the merged map.
"""

from dataclasses import replace

from merging.config import MergeConfig
from merging.joint_slam.rendering import redraw
from merging.merge_state import MergeState
from merging.pairwise import align_all
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor


def with_short_range_alignments(found: MergeState, config: MergeConfig, executor: Executor) -> MergeState:
    """Align the maps of different groups once more, by what was seen at short range; keep what is more confident.

    Parameters
    ----------
    found
        The maps, and what is known of them so far.
    config
        What is short, and how maps are aligned.
    executor
        What aligns them.
    """
    pairs = [pair for pair in found.apart() if all(found.maps[name].drives for name in pair)]
    if not (pairs and config.short_range.enabled and config.method == "correlation"):
        return found
    limit = config.short_range.range_m
    apart = {name for pair in pairs for name in pair}
    maps = {name: short_range_map(tbm_map, limit) for name, tbm_map in found.maps.items() if name in apart}
    again = align_all(maps, config, executor, pairs)
    better = {
        pair: replace(alignment, reason=f"by what was seen within {limit:g} m: {alignment.reason}")
        for pair, alignment in again.items()
        if alignment.confidence > found.alignments[pair].confidence
    }
    return found.with_alignments(better, {pair: (maps[pair[0]].grid, maps[pair[1]].grid) for pair in better})


def short_range_map(tbm_map: TbmMap, range_m: float) -> TbmMap:
    """Return a map's cells, rendered without the hits beyond a range [m]."""
    return TbmMap(redraw([drive.keyframes for drive in tbm_map.drives], tbm_map, range_m))
