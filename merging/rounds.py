"""Rounds of pairwise registration: all pairs of a few maps, the most similar pairs of many, and short ranges.

A merge of a thousand maps has half a million pairs, few of which show one place. Therefore each map is aligned first
with the maps that are most similar to it, and in later rounds with more maps that may join groups.

In the last round, maps of different groups are aligned again by short ranges. A wall that was seen from afar may be
drawn far from its place, and at a grazing angle it is hardly drawn: views along corridors contradict another map even
if both belong together. Where maps carry keyframes, their grids are rendered again from short ranges. Without this
round, one map of the recording ACES, cut into 8 robots and cut into 10, is left out of the merged map.
"""

import itertools
import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

from merging.alignment import Pair
from merging.config import MergeConfig
from merging.joint_slam import redraw
from merging.merge_state import MergeState
from merging.pairwise import align_all
from merging.retrieval import similarity_of_all
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor

logger = logging.getLogger(__name__)


def with_pairs_aligned(found: MergeState, config: MergeConfig, executor: Executor) -> MergeState:
    """Align pairs of maps of different groups: all pairs of a few maps, the most similar pairs of many maps.

    In the first round each map is aligned with the few most similar maps, in later rounds with more maps if that may
    join groups. Pairs of two single maps are not tried in later rounds: a map that does not fit the most similar maps
    hardly fits a single other map.

    Parameters
    ----------
    found
        The state of the merge.
    config
        The number of pairs of each round, and the parameters of the alignment.
    executor
        Compares and aligns the maps.
    """
    settings = config.retrieval
    pairs = [pair for pair in itertools.combinations(found.maps, 2) if not found.are_joined(pair)]
    if len(found.maps) <= settings.few or config.method != "correlation":
        return found.with_alignments(align_all(found.maps, config, executor, pairs))
    similarities = similarity_of_all(found.maps, config, executor)
    most_similar_first = sorted(similarities, key=lambda pair: -similarities[pair])
    order = _similar_together(list(found.maps), most_similar_first)
    for number, neighbours in enumerate(settings.neighbours):
        near = _nearest(most_similar_first, neighbours)
        new = [pair for pair in pairs if pair in near and pair not in found.alignments]
        new = [pair for pair in new if not number or _may_join(pair, found)]
        if new:
            aligned = align_all(found.maps, config, executor, sorted(new, key=_position_in(order)))
            found = found.with_alignments({pair: aligned[pair] for pair in new})
    logger.info("%d of %d pairs of maps were aligned", len(found.alignments), len(pairs))
    return found


def _nearest(most_similar_first: Sequence[Pair], count: int) -> Collection[Pair]:
    """Return the pairs of each map with its most similar maps, `count` of them."""
    near = dict[str, list[Pair]]()
    for pair in most_similar_first:
        for name in pair:
            if len(near.setdefault(name, [])) < count:
                near[name].append(pair)
    return {pair for pairs in near.values() for pair in pairs}


def _similar_together(names: Sequence[str], most_similar_first: Sequence[Pair]) -> Mapping[str, int]:
    """Return the position of each map in an order where similar maps are neighbours (single linkage).

    Pairs in this order use a map again soon, so a process need not hold all maps.
    """
    rows = {name: [name] for name in names}
    for first, second in most_similar_first:
        if rows[first] is not rows[second]:
            rows[first] += rows[second]
            rows |= dict.fromkeys(rows[second], rows[first])
    return {name: position for position, name in enumerate(rows[names[0]])}


def _position_in(order: Mapping[str, int]) -> Callable[[Pair], tuple[int, int]]:
    """Return the sort key of pairs: the positions of their maps in an order, the first one first."""
    return lambda pair: (min(order[name] for name in pair), max(order[name] for name in pair))


def _may_join(pair: Pair, found: MergeState) -> bool:
    """Return whether two maps are in different groups, one of which has several maps."""
    return not found.are_joined(pair) and any(len(found.group_of(name)) > 1 for name in pair)


def with_short_range_alignments(found: MergeState, config: MergeConfig, executor: Executor) -> MergeState:
    """Align the maps of different groups again by short ranges; keep alignments that are more confident than before."""
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
