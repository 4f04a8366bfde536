"""Rounds of pairwise registration: all pairs of a few maps, the most similar pairs of many, and short ranges.

A merge of a thousand maps has half a million pairs, and few of them show the same place. Therefore each map is aligned
first with the maps that are most similar to it, and in later rounds with more maps that may join groups.

Similarity needs no alignment. A map has places every two metres along its walls. Each place has a signature that does
not depend on the map's frame: a histogram of the distances and facings of pairs of wall points around it. Distant
places of one building are similar by chance, and the distribution of this similarity is estimated from each map. Two
maps are similar if many places of the first have a match in the second that exceeds chance, and if the matches preserve
the distances between the places.

In the last round, maps of different groups are aligned again by short ranges. A wall that was seen from afar may be
drawn far from its place, and a wall at a grazing angle is hardly drawn. Therefore views along corridors contradict
another map even if both belong together. Maps with keyframes are rendered again from short ranges. Without this
round, one map of the recording ACES, cut into 8 robots and cut into 10, is left out of the merged map.
"""

import itertools
import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from merging.alignment import Pair
from merging.config import MergeConfig
from merging.merge_state import MergeState
from merging.merged_group import grid_within
from merging.pairwise import CompressedGrid, align_all
from merging.walls import MOVABLE, WallMap
from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.search.place_matches import common_weight
from tbmslam.kernels.search.place_signatures import FACINGS, all_products, pair_signature, spread_points
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

logger = logging.getLogger(__name__)

# Chosen on 120 maps of 20 simulated buildings and 38 maps cut from real drives. A radius of 8 m, or bins of 0.5 m, find
# fewer pairs.
_STEP_M, _RADIUS_M = 2.0, 6.0
"""Distance between places, and radius of the walls of a place."""
_WALL_CELL_M, _MOST_WALLS, _FEWEST_WALLS = 0.2, 300, 15
"""Wall points are thinned to cells of this size; with fewer points than the least a place has no signature."""
_WIDTH_M, _BINS = 0.3, 40
_TOLERANCE_M, _NEAREST_M = 1.0, 3.0
_SCALE = 3000.0
"""Signatures are whole numbers of this length: float32 adds up whole numbers below 2**24 exactly, in any order, so that
every machine and number of threads finds the same matches."""
_ELSEWHERE_M = 8.0
"""Places of a map that are farther apart than this show different surroundings; their similarity is chance."""
_CHANCE, _CHANCE_SPREAD, _CHANCE_COUNT = 0.93, 0.05, 10.0
"""Mean and standard deviation of the similarity of such places in 200 simulated maps, and the number of places that
this prior counts for: a small map has few distant places."""
_LEAST = 1e-6
"""Weight of two maps without any agreement."""
_SUREST = 5.0
"""Largest number of standard deviations above chance that counts."""


@dataclass(frozen=True)
class MapPlaces:
    """The places of a map."""

    points: FloatArray
    """Positions (P, 2) in the map's frame [m]."""
    signatures: npt.NDArray[np.float32]
    """Signatures (P, B) of whole numbers."""
    chance: FloatArray
    """Mean and standard deviation (P, 2) of each place's similarity to places elsewhere."""

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self.points)

    @classmethod
    def of(cls, walls: WallMap) -> "MapPlaces":
        """Return the places along the walls of a map."""
        steady = walls.weights >= MOVABLE
        points, normals = (np.ascontiguousarray(part[steady]) for part in (walls.points, walls.normals))
        chosen = spread_points(points, _WALL_CELL_M, max(len(points), 1))
        points, normals = points[chosen], normals[chosen]
        if not len(points):
            return cls(np.zeros((0, 2)), np.zeros((0, _BINS * FACINGS), dtype=np.float32), np.zeros((0, 2)))
        blocks, member = np.unique(np.floor(points / _STEP_M), axis=0, return_inverse=True)
        counts = np.bincount(member.ravel(), minlength=len(blocks))
        centres = np.column_stack([np.bincount(member.ravel(), axis, len(blocks)) / counts for axis in points.T])
        around = cKDTree(points).query_ball_point(centres, _RADIUS_M, return_sorted=True)
        places = [(centre, _thinned(np.array(near))) for centre, near in zip(centres, around, strict=True)]
        places = [(centre, near) for centre, near in places if len(near) >= _FEWEST_WALLS]
        described = [pair_signature(points[near], normals[near], _WIDTH_M, _BINS) for _, near in places]
        where = np.array([centre for centre, _ in places]).reshape(-1, 2)
        signatures = np.rint(_SCALE * np.array(described).reshape(-1, _BINS * FACINGS)).astype(np.float32)
        return cls(where, signatures, _chance(where, signatures))

    def above_chance(self, similarities: FloatArray) -> FloatArray:
        """Return by how many standard deviations (P,) the largest similarities of (P, Q) exceed chance.

        The best of Q draws from a normal distribution lies about sqrt(2 ln Q) standard deviations above its mean.
        """
        mean, deviation = self.chance.T
        most_by_chance = mean + deviation * math.sqrt(2.0 * math.log(similarities.shape[1]))
        return np.asarray((similarities.max(axis=1) - most_by_chance) / deviation)


def _chance(points: FloatArray, signatures: npt.NDArray[np.float32]) -> FloatArray:
    """Return mean and standard deviation (P, 2) of the similarity of each place to distant places of its map."""
    elsewhere = cdist(points, points) > _ELSEWHERE_M
    similarities = _similarities(signatures, signatures)
    counts = _CHANCE_COUNT + elsewhere.sum(axis=1)
    means = (_CHANCE_COUNT * _CHANCE + np.where(elsewhere, similarities, 0.0).sum(axis=1)) / counts
    squares = np.where(elsewhere, (similarities - means[:, None]) ** 2, 0.0).sum(axis=1)
    return np.column_stack((means, np.sqrt((_CHANCE_COUNT * _CHANCE_SPREAD**2 + squares) / counts)))


def _similarities(signatures: npt.NDArray[np.float32], others: npt.NDArray[np.float32]) -> FloatArray:
    """Return the cosines (P, Q) between signatures."""
    return np.asarray(all_products(signatures, others), dtype=np.float64) / _SCALE**2


def _thinned(near: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return at most `_MOST_WALLS` of some indices, evenly chosen."""
    return near if len(near) <= _MOST_WALLS else near[np.arange(_MOST_WALLS) * len(near) // _MOST_WALLS]


def similarity(first: MapPlaces, second: MapPlaces) -> float:
    """Return the similarity of two maps: the log of the weight of consistent matches above chance, in both directions.

    It is normalised by the geometric mean of the numbers of places, since large maps have more matches by chance. It is
    symmetric and does not depend on other maps. It is -inf for a map without places.
    """
    if not (len(first) and len(second)):
        return -math.inf
    similarities = _similarities(first.signatures, second.signatures)
    agreeing = _common_log(first, second, similarities) + _common_log(second, first, similarities.T)
    return agreeing - 0.5 * math.log(len(first) * len(second))


def _common_log(first: MapPlaces, second: MapPlaces, similarities: FloatArray) -> float:
    """Return the log of the weight of the consistent matches of one map's places."""
    weights = np.exp(np.minimum(first.above_chance(similarities), _SUREST))
    matched = similarities.argmax(axis=1)
    common = common_weight(first.points, second.points, matched, weights, _TOLERANCE_M, _NEAREST_M)
    return math.log(common + _LEAST)


def similarity_of_all(maps: Mapping[str, TbmMap], config: MergeConfig, executor: Executor) -> dict[Pair, float]:
    """Return the similarity of every pair of maps, in the order of the maps."""
    places = [Call(f"places of {name}", _places, (CompressedGrid(first.grid), config)) for name, first in maps.items()]
    calls = [Call(f"similarity of {name}", _similarities_to, tuple(places[: n + 1])) for n, name in enumerate(maps)]
    rows: list[list[float]] = executor.results(calls, "comparing", "maps")
    return {(first, second): rows[n][m] for m, first in enumerate(maps) for n, second in enumerate(maps) if m < n}


def _similarities_to(*maps: MapPlaces) -> list[float]:
    """Return the similarities of the last map to each of the others."""
    *others, last = maps
    return [similarity(last, second) for second in others]


def _places(sent: CompressedGrid, config: MergeConfig) -> MapPlaces:
    return MapPlaces.of(WallMap.from_grid(sent.grid, config.structure))


def with_pairs_aligned(found: MergeState, config: MergeConfig, executor: Executor) -> MergeState:
    """Align pairs of maps of different groups: all pairs of a few maps, the most similar pairs of many maps.

    In the first round each map is aligned with the few most similar maps, in later rounds with more maps if that may
    join groups. Pairs of two single maps are not tried in later rounds: a map that does not fit the most similar maps
    hardly fits a single other map.
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
    """Return whether two maps are in different groups, and one of the groups has several maps."""
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
        pair: replace(alignment, reason=f"with ranges up to {limit:g} m: {alignment.reason}")
        for pair, alignment in again.items()
        if alignment.confidence > found.alignments[pair].confidence
    }
    return found.with_alignments(better, {pair: (maps[pair[0]].grid, maps[pair[1]].grid) for pair in better})


def short_range_map(tbm_map: TbmMap, range_m: float) -> TbmMap:
    """Return a map's cells, rendered without the hits beyond a range [m]."""
    return TbmMap(grid_within(tbm_map, range_m))
