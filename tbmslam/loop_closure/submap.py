"""A segment of a drive as a rigid submap, to which scans of this robot or another one are registered."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray, IntArray, compose, inverse
from tbmslam.kernels.rays.counting import count_scans
from tbmslam.kernels.rays.lattice import Lattice, PlainLattice
from tbmslam.kernels.search.correlation import (
    WALL,
    GainField,
    coarser_field,
    correlate,
    search_field,
    share_in_free_space,
    top_places,
)
from tbmslam.kernels.surfels.surfels import extent
from tbmslam.map.scan_hits import DriveHits
from tbmslam.sensing.laser_scan import Hits
from tbmslam.tracking.surfel_map import SurfelConfig, SurfelMap

_HITS = 160
"""Least number of hits of each keyframe in a submap: neighbours see the same."""


class SubmapConfig(FrozenConfig):
    """Submaps and the search in them."""

    length: float = Field(8.0, gt=0, description="travelled length; neighbours overlap by half [m]")
    resolution: float = Field(0.2, gt=0, description="side of a cell of the field that is searched [m]")
    max_range: float = Field(40.0, gt=0, description="hits beyond this are not used [m]")
    free_penalty: float = Field(0.5, ge=0, le=1, description="cost of a hit in free space, a hit on a wall gains 1")
    shift_cost: float = Field(
        0.03, ge=0, description="cost of a metre from the initial pose, as a share of all hits [1/m]"
    )
    same_place: float = Field(0.8, gt=0, description="poses farther apart are distinct [m]")
    turn_step: float = Field(0.025, gt=0, description="step of the heading in a search [rad]")


@dataclass(frozen=True)
class Find:
    """The pose at which points agree best with a submap."""

    pose: SE2
    score: float
    """Gain of the points there, less the cost of its distance, as a share of what walls under all of them gain."""
    ambiguity: float
    """Score of the best distinct pose, as a share of the score here; 1 is full ambiguity."""
    at_border: bool
    """Whether its shift is on the border of a window of more than two cells, so that a better one may be outside."""


@dataclass(frozen=True)
class Fit:
    """The registration of points to the surfaces of a submap."""

    pose: SE2
    """Pose of their frame."""
    hessian: FloatArray
    """Curvature (3, 3) there in x, y [1/m^2] and theta."""
    matched: float
    """Share of the points on surfaces."""
    violated: float
    """Share of the points in the free space of the submap."""


class Submap:
    """Surfaces and free space seen by the keyframes `first` to `last`, in the frame of the laser at `anchor`."""

    _PRIOR = np.diag([0.5**-2.0, 0.5**-2.0, 0.2**-2.0])
    _SEARCH = 1e9, 0.25, 40.0, np.array([30.0, 12.0, 4.5]), 10_000, 10  # a normal prior; bundles count for 40 hits

    def __init__(self, first: int, last: int, drive: DriveHits, config: SubmapConfig, surfels: SurfelConfig) -> None:
        self.first, self.last, self.anchor = first, last, (first + last) // 2
        self._config = config
        chosen = np.arange(first, last + 1)
        hits = drive.placed(chosen, self.anchor, _HITS * len(chosen))
        self._surfaces = SurfelMap.of(hits, surfels)
        T_map_anchor = drive.poses[None, self.anchor]
        lasers = compose(inverse(T_map_anchor), drive.poses[first : last + 1])
        begins = drive.begins(chosen, _HITS * len(chosen))
        self._field, lattice = _search_field(lasers, hits.points, begins, config)
        self._lattice: PlainLattice = (*lattice,)

    def search(self, points: FloatArray, guess: SE2, shift: float, turn: float) -> Find:
        """Find the pose at which points (N, 2) agree best with the submap, within `shift` [m] and `turn` [rad].

        Hits on walls support a pose, hits in free space contradict it, and hits in unknown space do neither. Of poses
        with equal sums the one with the shortest shift is taken, and with equal shifts the one farthest clockwise.
        """
        (best, place, at_border), (rival, *_) = self._best(points, guess, shift, turn, 2)
        ambiguity = max(rival, 0.0) / best if best > 0.0 else 1.0
        return Find(place, best / (WALL * max(len(points), 1)), ambiguity, at_border)

    def places(self, points: FloatArray, guess: SE2, shift: float, turn: float, count: int) -> list[SE2]:
        """Return up to `count` poses at which points (N, 2) agree best with the submap, the best first; see `search`.

        Poses on the border of the window are left out.
        """
        found = self._best(points, guess, shift, turn, count)
        return [place for score, place, at_border in found if score > 0.0 and not at_border]

    def rough_places(
        self, points: FloatArray, guess: SE2, shift: float, turn: float, count: int
    ) -> list[tuple[float, SE2]]:
        """Return the scores and poses of up to `count` best poses, searched in steps twice as large.

        The distance from the guess costs nothing here.
        """
        found = self._best(points, guess, shift, min(turn, math.pi), count, rough=True)
        return [(score / (WALL * len(points)), place) for score, place, _ in found if score > 0.0]

    def _best(
        self, points: FloatArray, guess: SE2, shift: float, turn: float, count: int, *, rough: bool = False
    ) -> list[tuple[float, SE2, bool]]:
        """Return scores and poses of the best places, and whether each is on the border of the window."""
        field, lattice = self._rough_field if rough else (self._field, self._lattice)
        (resolution, _, _), turn_step = lattice, self._config.turn_step * (2.0 if rough else 1.0)
        cost = 0.0 if rough else self._config.shift_cost * resolution * WALL * len(points)
        reach, half = math.ceil(shift / resolution), math.ceil(turn / turn_step)
        turns = np.arange(-half, half + 1, dtype=np.float64) * turn_step
        clear = math.ceil(self._config.same_place / resolution)
        scores, found = top_places(correlate(field, lattice, points, (*guess,), turns, reach), cost, clear, count)
        places = []
        for score, (k, row, col) in zip(scores.tolist(), found.tolist(), strict=True):
            up, right = row - reach, col - reach
            x, y = guess.x + right * resolution, guess.y + up * resolution
            at_border = reach > 2 and max(abs(up), abs(right)) == reach
            places.append((score, SE2(x, y, guess.theta + (k - half) * turn_step), at_border))
        return places

    @cached_property
    def _rough_field(self) -> tuple[GainField, PlainLattice]:
        """The field in cells twice as large."""
        return coarser_field(self._field, self._lattice)

    def fit(self, hits: Hits, guess: SE2) -> Fit:
        """Register hits to the surfaces from an initial guess, and verify them."""
        laid = self._surfaces.register(hits, guess, guess, self._PRIOR, self._SEARCH)
        violated = share_in_free_space(self._field, self._lattice, hits.points, (*laid.pose,))
        return Fit(laid.pose, laid.hessian, laid.matched, violated)


def _search_field(
    lasers: FloatArray, ends: FloatArray, begins: IntArray, config: SubmapConfig
) -> tuple[GainField, Lattice]:
    """Return the gain of a hit in each cell, and the lattice, from the ends (N, 2) of scans of lasers (K, 3)."""
    spans = zip(extent(lasers), extent(ends), strict=True)
    left, right, bottom, top = (
        math.floor((max(pair) if upper else min(pair)) / config.resolution)
        for pair, upper in zip(spans, (False, True, False, True), strict=True)
    )
    lattice = Lattice(config.resolution, bottom - 1, left - 1)
    counts = np.zeros((top - bottom + 3, right - left + 3), dtype=np.int64)
    count_scans(counts, lattice, lasers, ends, np.ones(len(ends), dtype=np.bool_), begins, 0)
    return search_field(counts, config.free_penalty), lattice


def split_into_submaps(travelled: FloatArray, length: float) -> list[tuple[int, int]]:
    """Return the (first, last) keyframes of segments of a drive, each `length` metres long and overlapping by half.

    `travelled` (K,) is the length of the path to each keyframe [m].
    """
    count = max(math.ceil(2.0 * travelled[-1] / length) - 1, 1)
    stretches = []
    for number in range(count):
        begin = 0.5 * length * number
        first = int(np.searchsorted(travelled, begin, side="left"))
        last = int(np.searchsorted(travelled, begin + length, side="right")) - 1
        if first <= last:
            stretches.append((first, last))
    return stretches


def open_direction(hessian: FloatArray, least: float) -> FloatArray | None:
    """Return the direction (2,) that a fit does not determine; None if it determines all.

    `hessian` (3, 3) is the curvature in x, y and theta. `least` is the least curvature of a determined direction
    relative to the direction across it.
    """
    (xx, xy), (_, yy) = hessian[:2, :2].tolist()
    middle, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    spread = math.hypot(half, xy)
    if middle - spread >= least * (middle + spread):
        return None
    weak = 0.5 * math.atan2(xy, half) + 0.5 * math.pi
    return np.array([math.cos(weak), math.sin(weak)])


def without_open_direction(hessian: FloatArray, least: float) -> FloatArray:
    """Return the curvature (3, 3) without the direction that a fit does not determine.

    Along a corridor many poses fit, but they determine the distance of its walls and its direction.
    """
    direction = open_direction(hessian, least)
    if direction is None:
        return hessian
    kept = np.eye(3)
    kept[:2, :2] -= np.outer(direction, direction)
    closed: FloatArray = kept @ hessian @ kept
    return closed
