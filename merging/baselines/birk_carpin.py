"""Birk and Carpin: a random walk with adaptive steps finds the pose at which two maps are most similar.

A. Birk, S. Carpin, "Merging occupancy grid maps from multiple robots", Proceedings of the IEEE, 2006; the walk is that
of S. Carpin, G. Pillonetto, "Motion planning using adaptive random walks", 2005. Cells are free, wall or unknown. Two
maps are the less alike the farther the cells of either are from the nearest cell of the same state in the other, as
means over the cells of a state, by the Manhattan distance; cells that meet and disagree cost more, those that agree
save some (the "lock"). Alignments with a low acceptance index, ai = 1 - agr / (agr + dis), are accepted. Fusion that
makes disagreeing cells unknown is the rule `unanimous`.

Chosen here: many walks at once, which start all over the plane, instead of one; the second half of the steps is walked
from the best place so far; the covariance of the steps is diagonal; a sample of the cells is compared, so that a step
costs the same for every map; the lock counts shares of the cells.
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
    place = _walk(_Likeness.of(*maps, placing, settings), placing, settings)
    index = float(Agreement.of(*maps, placing, place[None]).index()[0])
    words = f"acceptance index {index:.3f}, to be at most {settings.max_index:g}"
    return judged_alignment("birk-carpin", maps, placing, place, (words, index <= settings.max_index), config)


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
class _Likeness:
    """The dissimilarity of two maps at placements."""

    maps: tuple[CellStates, CellStates]
    placing: Placing
    sides: list[tuple[_Side, _Side]]
    settings: BirkCarpinConfig

    @classmethod
    def of(cls, target: CellStates, source: CellStates, placing: Placing, settings: BirkCarpinConfig) -> "_Likeness":
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


def _walk(likeness: _Likeness, placing: Placing, settings: BirkCarpinConfig) -> FloatArray:
    """Return the best pose of the random walks."""
    rng = np.random.default_rng(settings.seed)
    radius = 0.5 * placing.reach_m * np.sqrt(rng.random(settings.walkers))
    angle = 2.0 * np.pi * rng.random(settings.walkers)
    turns = 2.0 * np.pi * np.arange(settings.walkers) / settings.walkers
    starts = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), turns))
    wide = np.array((0.1 * placing.reach_m, 0.1 * placing.reach_m, 0.3))
    best, _ = _steps(likeness, starts, wide, settings.steps // 2, settings, rng)
    narrow = np.array((0.5, 0.5, 0.05))
    best, _ = _steps(
        likeness, np.tile(best, (settings.walkers, 1)), narrow, settings.steps - settings.steps // 2, settings, rng
    )
    return best


def _steps(
    likeness: _Likeness,
    places: FloatArray,
    spread: FloatArray,
    count: int,
    settings: BirkCarpinConfig,
    rng: np.random.Generator,
) -> tuple[FloatArray, float]:
    """Walk from placements (K, 3); the distribution of steps adapts to the last steps of each walk."""
    costs = likeness.cost(places)
    # The width of the first steps is set by assumed steps before them.
    taken = rng.normal(0.0, 1.0, (settings.memory, len(places), 3)) * spread
    slots: npt.NDArray[np.intp] = np.zeros(len(places), dtype=np.intp)
    best, least = places[costs.argmin()].copy(), float(costs.min())
    for _ in range(count):
        deviation = np.maximum(taken.std(axis=0), 0.02 * spread)
        steps = rng.normal(taken.mean(axis=0), deviation)
        found = likeness.cost(places + steps)
        accepted = (found < costs) | (rng.random(len(places)) < settings.daring)
        places = np.where(accepted[:, None], places + steps, places)
        costs = np.where(accepted, found, costs)
        # A refused step counts as a step of half the width, so that the next steps are smaller.
        taken[slots, np.arange(len(places))] = np.where(accepted[:, None], steps, steps * rng.uniform(-0.5, 0.5))
        slots = (slots + 1) % settings.memory
        if costs.min() < least:
            best, least = places[costs.argmin()].copy(), float(costs.min())
    return best, least
