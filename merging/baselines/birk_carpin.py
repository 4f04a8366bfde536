"""Birk and Carpin: a random walk with adaptive steps finds the pose at which two maps are most similar.

A. Birk, S. Carpin, "Merging occupancy grid maps from multiple robots", Proceedings of the IEEE, 2006. The random walk
is by S. Carpin, G. Pillonetto, "Motion planning using adaptive random walks", 2005. Cells are free, wall or unknown.
The dissimilarity of two maps is the mean Manhattan distance from the cells of either map to the nearest cell of the
same state in the other map. Disagreeing cells increase the cost, and agreeing cells reduce it (the "lock"). Alignments
with a low acceptance index, ai = 1 - agr / (agr + dis), are accepted. The rule `unanimous` fuses cells, and makes
disagreeing cells unknown.

Choices of this project: Many walks start all over the plane at once, instead of one. The second half of the steps
starts at the best pose so far. The covariance of the steps is diagonal. A sample of the cells is compared, so that a
step costs the same for every map. The lock counts shares of the cells.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from merging.alignment import Alignment
from merging.baselines.cell_states import IS_FREE, IS_WALL, CellField, CellStates, Points
from merging.baselines.placing import Agreement, Placing, judged_alignment
from merging.config import BirkCarpinConfig, MergeConfig
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import FloatArray


def align(target: TbmGrid, source: TbmGrid, config: MergeConfig) -> Alignment:
    """Estimate the pose of a source grid in the target's frame; both have known cells."""
    settings = config.baselines.birk_carpin
    maps = CellStates.of(target), CellStates.of(source)
    placing = Placing.of(*maps)
    place = _walk(_Dissimilarity.of(*maps, placing, settings), placing, settings)
    index = float(Agreement.of(*maps, placing, place[None]).index()[0])
    criterion = f"acceptance index {index:.3f}, accepted up to {settings.max_index:g}"
    return judged_alignment("birk-carpin", maps, placing, place, (criterion, index <= settings.max_index), config)


@dataclass(frozen=True)
class _Side:
    """Sampled cells of a state, and the Manhattan distance of each cell to the nearest of these [cells]."""

    points: Points
    distances: CellField

    @classmethod
    def of(cls, states: CellStates, state: int, sample: int) -> "_Side":
        there = states.states == state
        distances = cv2.distanceTransform((~there).astype(np.uint8), cv2.DIST_L1, 3)
        return cls(states.some(there, sample), CellField.of(distances, states.geometry))

    def mean_distance(self, points: Points) -> FloatArray:
        """Return mean distances (K,) [cells] of points (K, N) from this state's cells, estimated outside the grid."""
        geometry = self.distances.geometry
        left, bottom, right, top = geometry.bounds()
        margin = 0.5 * geometry.resolution
        x = np.clip(points.real, left + margin, right - margin)
        y = np.clip(points.imag, bottom + margin, top - margin)
        beyond = (np.abs(points.real - x) + np.abs(points.imag - y)) / geometry.resolution
        return np.asarray((self.distances.at(x + 1j * y) + beyond).mean(axis=1), dtype=np.float64)


@dataclass(frozen=True)
class _Dissimilarity:
    """Computes the dissimilarity of two maps at placements."""

    maps: tuple[CellStates, CellStates]
    placing: Placing
    sides: list[tuple[_Side, _Side]]
    settings: BirkCarpinConfig

    @classmethod
    def of(
        cls, target: CellStates, source: CellStates, placing: Placing, settings: BirkCarpinConfig
    ) -> "_Dissimilarity":
        states = [
            state for state in (IS_FREE, IS_WALL) if all((cells.states == state).any() for cells in (target, source))
        ]
        sides = [
            (_Side.of(target, state, settings.sample), _Side.of(source, state, settings.sample)) for state in states
        ]
        return cls((target, source), placing, sides, settings)

    def cost(self, places: FloatArray) -> FloatArray:
        """Return psi + lock * (dis - agr) at placements (K, 3)."""
        total = np.zeros(len(places))
        for target, source in self.sides:
            total += target.mean_distance(self.placing.into_target(source.points, places))
            total += source.mean_distance(self.placing.into_source(target.points, places))
        agreement = Agreement.of(*self.maps, self.placing, places, 2 * self.settings.sample)
        return total + self.settings.lock * (agreement.disagreeing - agreement.agreeing)


def _walk(dissimilarity: _Dissimilarity, placing: Placing, settings: BirkCarpinConfig) -> FloatArray:
    """Return the best pose of the random walks."""
    rng = np.random.default_rng(settings.seed)
    radius = 0.5 * placing.reach_m * np.sqrt(rng.random(settings.walkers))
    angle = 2.0 * np.pi * rng.random(settings.walkers)
    turns = 2.0 * np.pi * np.arange(settings.walkers) / settings.walkers
    starts = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), turns))
    wide = np.array((0.1 * placing.reach_m, 0.1 * placing.reach_m, 0.3))
    best, _ = _steps(dissimilarity, starts, wide, settings.steps // 2, settings, rng)
    narrow = np.array((0.5, 0.5, 0.05))
    best, _ = _steps(
        dissimilarity, np.tile(best, (settings.walkers, 1)), narrow, settings.steps - settings.steps // 2, settings, rng
    )
    return best


def _steps(
    dissimilarity: _Dissimilarity,
    places: FloatArray,
    spread: FloatArray,
    count: int,
    settings: BirkCarpinConfig,
    rng: np.random.Generator,
) -> tuple[FloatArray, float]:
    """Walk from placements (K, 3); the distribution of steps adapts to the last steps of each walk."""
    costs = dissimilarity.cost(places)
    # The width of the first steps is set by assumed steps before them.
    taken = rng.normal(0.0, 1.0, (settings.memory, len(places), 3)) * spread
    slots: npt.NDArray[np.intp] = np.zeros(len(places), dtype=np.intp)
    best, least = places[costs.argmin()].copy(), float(costs.min())
    for _ in range(count):
        deviation = np.maximum(taken.std(axis=0), 0.02 * spread)
        steps = rng.normal(taken.mean(axis=0), deviation)
        found = dissimilarity.cost(places + steps)
        accepted = (found < costs) | (rng.random(len(places)) < settings.daring)
        places = np.where(accepted[:, None], places + steps, places)
        costs = np.where(accepted, found, costs)
        # A refused step counts as a step of half the width, so that the next steps are smaller.
        taken[slots, np.arange(len(places))] = np.where(accepted[:, None], steps, steps * rng.uniform(-0.5, 0.5))
        slots = (slots + 1) % settings.memory
        if costs.min() < least:
            best, least = places[costs.argmin()].copy(), float(costs.min())
    return best, least
