"""Similarity of maps before any alignment: of a thousand maps few pairs show one place.

A map has places every two metres along its walls. Each place has a signature that does not depend on the map's frame:
the distances and facings of the walls around it. Distant places of one building are similar by chance. The distribution
of this similarity is estimated from each map. Two maps are similar if many places of the first have a match in the
second that exceeds chance, and if the matches preserve the distances between the places.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from merging.alignment import Pair
from merging.config import MergeConfig
from merging.pairwise import CompressedGrid
from merging.walls import WallMap
from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.search.place_matches import common_weight
from tbmslam.kernels.search.place_signatures import FACINGS, all_products, pair_signature, spread_points
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

# Chosen on 120 maps of 20 simulated buildings and 38 maps cut from real drives; 8 m, and bins of 0.5 m, find fewer.
_STEP_M, _RADIUS_M = 2.0, 6.0
"""Distance between places, and radius of the walls of a place."""
_WALL_CELL_M, _MOST_WALLS, _FEWEST_WALLS = 0.2, 300, 15
"""Wall points are thinned to cells of this size; with fewer points than the least a place has no signature."""
_WIDTH_M, _BINS = 0.3, 40
_TOLERANCE_M, _NEAREST_M = 1.0, 3.0
_MOVABLE = 0.5
"""Wall points with less weight are movable objects."""
_SCALE = 3000.0
"""Signatures are whole numbers of this length: float32 adds up whole numbers below 2**24 exactly, in any order, so that
every machine and number of threads finds the same matches."""
_ELSEWHERE_M = 8.0
"""Places of a map that are farther apart than this show different surroundings; their similarity is chance."""
_CHANCE, _CHANCE_SPREAD, _CHANCE_COUNT = 0.93, 0.05, 10.0
"""Mean and standard deviation of the similarity of such places in 200 simulated maps, and the number of places that
this prior counts for: a small map has few distant places."""
_LEAST = 1e-6
"""Weight of no agreement at all."""
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
        steady = walls.weights >= _MOVABLE
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
