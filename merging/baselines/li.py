"""Li and Nashashibi: a genetic algorithm maximises the likelihood of the source's occupancy in the target.

H. Li, F. Nashashibi, "A new method for occupancy grid maps merging: application to multi-vehicle cooperative local
mapping and moving object detection in outdoor environment", ICARCV 2012; H. Li, M. Tsukada, F. Nashashibi, M. Parent,
"Multivehicle cooperative local mapping", 2014. The score of a pose depends on the occupancy probabilities of
overlapping cells. Vehicles have a rough initial pose, and the genetic algorithm refines it. The rule `average` fuses
cells.

Choices of this project: The genetic algorithm is differential evolution (scipy). There is no initial pose, so it
searches the whole plane. The score is computed on samples of walls and of free cells. It is the mean difference of the
target's blurred probability from one half, positive if it agrees with the sample, so that unknown cells have no effect.
A pose is accepted if the walls on known cells have a sufficient mean likelihood.
"""

import cv2
import numpy as np
from scipy.optimize import Bounds, differential_evolution

from merging.alignment import Alignment
from merging.baselines.cell_states import IS_FREE, IS_UNKNOWN, IS_WALL, CellField, CellStates, Field, Points
from merging.baselines.placing import Placing, judged_alignment
from merging.config import LiConfig, MergeConfig
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import pignistic
from tbmslam.geometry.se2 import FloatArray


def align(target: TbmGrid, source: TbmGrid, config: MergeConfig) -> Alignment:
    """Estimate the pose of a source grid in the target's frame; both have known cells."""
    settings = config.baselines.li
    maps = CellStates.of(target), CellStates.of(source)
    walls, free = (maps[1].some(maps[1].states == state, settings.sample) for state in (IS_WALL, IS_FREE))
    if len(walls) == 0 or not (maps[0].states == IS_WALL).any():
        return Alignment("li", accepted=False, reason="a map has no walls")
    placing = Placing.of(*maps)
    evidence = CellField.of(_evidence(target, settings.blur_m), target.geometry)

    def loss(vectors: FloatArray) -> FloatArray:
        """Return the losses of placements (3, K)."""
        places = vectors.reshape(3, -1).T
        occupied = evidence.at(placing.into_target(walls, places)).mean(axis=1)
        empty = evidence.at(placing.into_target(free, places)).mean(axis=1) if len(free) else 0.0
        return np.asarray(empty - occupied, dtype=np.float64)

    reach = 0.8 * placing.reach_m
    found = differential_evolution(
        loss,  # type: ignore[arg-type]  # the stubs lack vectorised objectives
        Bounds([-reach, -reach, -np.pi], [reach, reach, np.pi]),
        strategy="best1bin",
        popsize=1,
        init=_population(settings, reach),
        maxiter=settings.generations,
        mutation=(0.4, 0.9),
        recombination=0.8,
        tol=0.0,
        seed=np.random.default_rng(settings.seed),
        polish=False,
        updating="deferred",
        vectorized=True,
    )
    place = np.asarray(found.x, dtype=np.float64)
    likelihood = _likelihood(evidence, maps[0], placing.into_target(walls, place[None])[0])
    criterion = (
        f"mean likelihood {likelihood:.2f} of the walls on known cells, accepted from {settings.min_likelihood:g}"
    )
    return judged_alignment("li", maps, placing, place, (criterion, likelihood >= settings.min_likelihood), config)


def _population(settings: LiConfig, reach: float) -> FloatArray:
    """Return the first generation (population, 3) of uniform distribution."""
    rng = np.random.default_rng(settings.seed)
    return rng.uniform((-reach, -reach, -np.pi), (reach, reach, np.pi), (settings.population, 3))


def _evidence(grid: TbmGrid, blur_m: float) -> Field:
    """Return the blurred evidence of each cell: 1 is occupied, -1 is free, 0 is unknown.

    A wall a little beside where it should be is still likely: near walls the blurred wall counts, not the free space.
    """
    evidence = (2.0 * pignistic(grid.masses) - 1.0).astype(np.float32)
    sigma = blur_m / grid.geometry.resolution
    near = cv2.GaussianBlur(np.maximum(evidence, 0.0), (0, 0), sigma)
    # The maximum of a blurred thin line stays 1.
    near = np.minimum(near * sigma * np.sqrt(2.0 * np.pi), 1.0)
    return np.asarray(np.where(near > 0.1, near, np.minimum(evidence, near)), dtype=np.float32)


def _likelihood(evidence: CellField, target: CellStates, points: Points) -> float:
    """Return the mean probability of being occupied at points in known cells; 0 for fewer than ten points."""
    known = target.field.at(points) != IS_UNKNOWN
    if np.count_nonzero(known) < 10:
        return 0.0
    return float((0.5 + 0.5 * evidence.at(points)[known]).mean())
