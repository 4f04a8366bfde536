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
from merging.joint_slam.joint_optimisation import redraw
from merging.merge_state import MergeState
from merging.pairwise import align_all
from merging.retrieval import likeness_of_all
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor

logger = logging.getLogger(__name__)


def with_pairs_aligned(found: MergeState, config: MergeConfig, executor: Executor) -> MergeState:
    """Align pairs of maps of different groups: all pairs of a few maps, the likeliest pairs of many.

    In the first round each map is aligned with the few maps that look most like it, in later rounds with more of them,
    where that may join groups. Two maps that fit nothing so far are not tried further: a map that fits none of those
    most like it is a stranger to the others, unless these are many that belong together.

    Parameters
    ----------
    found
        The maps, and what is known of them so far.
    config
        How many pairs are aligned in a round, and how.
    executor
        What compares and aligns the maps.
    """
    how = config.retrieval
    pairs = [pair for pair in itertools.combinations(found.maps, 2) if not found.are_joined(pair)]
    if len(found.maps) <= how.few or config.method != "correlation":
        return found.with_alignments(align_all(found.maps, config, executor, pairs))
    alike = likeness_of_all(found.maps, config, executor)
    likeliest_first = sorted(alike, key=lambda pair: -alike[pair])
    order = _like_beside_like(list(found.maps), likeliest_first)
    for turn, neighbours in enumerate(how.neighbours):
        near = _nearest(likeliest_first, neighbours)
        new = [pair for pair in pairs if pair in near and pair not in found.alignments]
        new = [pair for pair in new if not turn or _may_join(pair, found)]
        if new:
            aligned = align_all(found.maps, config, executor, sorted(new, key=_place_in(order)))
            found = found.with_alignments({pair: aligned[pair] for pair in new})
    logger.info("%d of %d pairs of maps were aligned", len(found.alignments), len(pairs))
    return found


def _nearest(likeliest_first: Sequence[Pair], count: int) -> Collection[Pair]:
    """Return the pairs of each map with so many others that look most like it."""
    near = dict[str, list[Pair]]()
    for pair in likeliest_first:
        for name in pair:
            if len(near.setdefault(name, [])) < count:
                near[name].append(pair)
    return {pair for some in near.values() for pair in some}


def _like_beside_like(names: Sequence[str], likeliest_first: Sequence[Pair]) -> Mapping[str, int]:
    """Return the place of each map in a row where maps that look alike stand together (single linkage).

    Pairs in this order come back to a map soon: who aligns them need not hold all maps at once.
    """
    rows = {name: [name] for name in names}
    for one, other in likeliest_first:
        if rows[one] is not rows[other]:
            rows[one] += rows[other]
            rows |= dict.fromkeys(rows[other], rows[one])
    return {name: place for place, name in enumerate(rows[names[0]])}


def _place_in(order: Mapping[str, int]) -> Callable[[Pair], tuple[int, int]]:
    """Return how pairs are sorted whose maps stand in a row: by the map that stands first."""
    return lambda pair: (min(order[name] for name in pair), max(order[name] for name in pair))


def _may_join(pair: Pair, found: MergeState) -> bool:
    """Tell whether two maps are in different groups, one of them of several maps."""
    return not found.are_joined(pair) and any(len(found.group_of(name)) > 1 for name in pair)


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
