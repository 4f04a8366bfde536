"""Which maps may show one place: of a thousand maps only those that look alike are aligned.

A map has places every two metres along its walls. Each place has a signature that does not depend on the map's frame:
the distances and facings of the walls around it. Two maps are alike if many places of the first have a match in the
second that is better than in other maps, and if the matches keep the distances between the places.
"""

import itertools
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from merging.alignment import Pair
from merging.config import MergeConfig
from merging.pairwise import CompressedGrid
from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.search.place_matches import common_weight
from tbmslam.kernels.search.place_signatures import FACINGS, pair_signature, spread_points
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

logger = logging.getLogger(__name__)

# Chosen on 120 maps of 20 simulated buildings and 38 maps cut from real drives; 8 m, and bins of 0.5 m, find fewer.
_STEP_M, _RADIUS_M = 2.0, 6.0
"""Places lie so far apart, and walls within the radius belong to a place."""
_WALL_CELL_M, _MOST_WALLS, _FEWEST_WALLS = 0.2, 300, 15
"""Wall points are thinned to cells of this size; with fewer points than the least a place has no signature."""
_WIDTH_M, _BINS = 0.3, 40
_TOLERANCE_M, _NEAREST_M = 1.0, 3.0
_MOVABLE = 0.5
"""Wall points that count less are movable objects."""
_SCALE = 3000.0
"""Signatures are whole numbers of this length: float32 adds up whole numbers below 2**24 exactly, in any order, so that
every machine and number of threads finds the same matches."""
_OUTSTANDING = 2.5
"""Standard deviations above the mean of all maps at which a match gains the weight 1."""


@dataclass(frozen=True)
class MapPlaces:
    """The places of a map.

    Parameters
    ----------
    points
        Where they are (P, 2) in the map's frame [m].
    signatures
        What they look like (P, B): whole numbers.
    """

    points: FloatArray
    signatures: npt.NDArray[np.float32]

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
            return cls(np.zeros((0, 2)), np.zeros((0, _BINS * FACINGS), dtype=np.float32))
        blocks, member = np.unique(np.floor(points / _STEP_M), axis=0, return_inverse=True)
        counts = np.bincount(member.ravel(), minlength=len(blocks))
        centres = np.column_stack([np.bincount(member.ravel(), axis, len(blocks)) / counts for axis in points.T])
        around = cKDTree(points).query_ball_point(centres, _RADIUS_M, return_sorted=True)
        places = [(centre, _thinned(np.array(near))) for centre, near in zip(centres, around, strict=True)]
        places = [(centre, near) for centre, near in places if len(near) >= _FEWEST_WALLS]
        signatures = [pair_signature(points[near], normals[near], _WIDTH_M, _BINS) for _, near in places]
        return cls(
            np.array([centre for centre, _ in places]).reshape(-1, 2),
            np.rint(_SCALE * np.array(signatures).reshape(-1, _BINS * FACINGS)).astype(np.float32),
        )


def _thinned(near: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return at most `_MOST_WALLS` of some indices, evenly chosen."""
    return near if len(near) <= _MOST_WALLS else near[np.arange(_MOST_WALLS) * len(near) // _MOST_WALLS]


def likeness(maps: Sequence[MapPlaces]) -> FloatArray:
    """Return how much maps look alike (N, N): the log of a ratio to what is usual for both.

    It is symmetric. A map is not like itself, and a map without places is like none: -inf.

    Parameters
    ----------
    maps
        The places of two maps or more.
    """
    alike = np.full((len(maps), len(maps)), -np.inf)
    described = [number for number, one in enumerate(maps) if len(one)]
    if len(described) > 1:
        logs = np.array(
            [_common_logs(number, [maps[other] for other in described]) for number in range(len(described))]
        )
        alike[np.ix_(described, described)] = logs + logs.T
    np.fill_diagonal(alike, -np.inf)
    return alike


def _common_logs(index: int, maps: Sequence[MapPlaces]) -> FloatArray:
    """Return the log of how much of one map is matched in each map (N,), less the median; 0 for itself."""
    one, others = maps[index], [number for number in range(len(maps)) if number != index]
    similarities = [one.signatures @ maps[other].signatures.T for other in others]
    best = np.column_stack([values.max(axis=1) for values in similarities])
    deviation = np.maximum(best.std(axis=1, keepdims=True), 1.0)
    weights = np.exp(np.maximum((best - best.mean(axis=1, keepdims=True)) / deviation, 0.0) - _OUTSTANDING)
    logs = np.zeros(len(maps))
    for column, (other, values) in enumerate(zip(others, similarities, strict=True)):
        matched, weight = values.argmax(axis=1), np.ascontiguousarray(weights[:, column])
        common = common_weight(one.points, maps[other].points, matched, weight, _TOLERANCE_M, _NEAREST_M)
        logs[other] = np.log(common + 1e-3)
    logs[others] -= np.median(logs[others])
    return logs


def pairs_to_align(maps: Mapping[str, TbmMap], config: MergeConfig, executor: Executor) -> list[Pair]:
    """Return the pairs of each map with the maps most like it: all pairs where there are few maps.

    Parameters
    ----------
    maps
        Maps by name.
    config
        With how many others a map is aligned.
    executor
        What finds the places of each map.
    """
    names = list(maps)
    pairs = list(itertools.combinations(names, 2))
    neighbours = config.retrieval.neighbours
    if len(names) <= neighbours + 1 or config.method != "correlation":
        return pairs
    calls = [Call(f"places of {name}", _places, (CompressedGrid(maps[name].grid), config)) for name in names]
    places: list[MapPlaces] = executor.results(calls, "describing", "maps")
    with executor.watch.during("retrieval"):
        nearest = np.argsort(-likeness(places), axis=1, kind="stable")[:, :neighbours]
    chosen = {frozenset((name, names[other])) for name, row in zip(names, nearest, strict=True) for other in row}
    logger.info("%d of %d pairs of maps look alike and are aligned", len(chosen), len(pairs))
    return [pair for pair in pairs if frozenset(pair) in chosen]


def _places(sent: CompressedGrid, config: MergeConfig) -> MapPlaces:
    return MapPlaces.of(WallMap.from_grid(sent.grid, config.structure))
