"""Saeedi et al.: probabilistic generalised Voronoi diagrams of two maps are matched.

S. Saeedi, L. Paull, M. Trentini, M. Seto, H. Li, "Efficient map merging using a probabilistic generalized Voronoi
diagram", IROS 2012, and "Group mapping: a topological approach to map merging for multiple robots", 2014. The diagram
runs midway between obstacles, and each of its cells carries the probability of the occupancy grid. Log odds are then
added (rule `log-odds`). An entropy filter rejects changes that make a cell less certain (rule `entropy-filter`).

Choices of this project: The diagram is the integer medial axis (W. Hesselink, J. Roerdink, 2008): free cells and their
neighbours have different nearest walls. Hough spectra of the diagrams give candidates for the rotation. For each, all
shifts are tried by correlating diagram cells of similar clearance. The best poses are refined by hill climbing on the
same score. A pose is accepted if the entropy filter accepts a sufficient share of the cells of the overlap.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from merging.alignment import Alignment
from merging.baselines.cell_states import IS_FREE, IS_WALL, CellField, CellStates, Points
from merging.baselines.placing import (
    Agreement,
    Channel,
    Placing,
    ShiftSearch,
    climb,
    hough_spectrum,
    judged_alignment,
    likely_turns,
)
from merging.config import MergeConfig, SaeediConfig
from merging.walls import nearest_cells
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import pignistic
from tbmslam.geometry.se2 import FloatArray

_CLEARANCES_M = (0.0, 0.6, 1.0, 1.6, np.inf)
"""Intervals of the distance to walls; cells of the diagram in the same interval may match."""
_FINALISTS = 24


@dataclass(frozen=True)
class VoronoiDiagram:
    """The lines midway between walls."""

    points: Points
    """Its cells (N,)."""
    probabilities: FloatArray
    """Probability (N,) of free space."""
    clearances_m: FloatArray
    """Distances to the nearest wall (N,) [m]."""

    @classmethod
    def of(cls, grid: TbmGrid, states: CellStates, min_apart_m: float) -> "VoronoiDiagram":
        """Find the free cells whose neighbours have different nearest walls."""
        wall = states.states == IS_WALL
        resolution = grid.geometry.resolution
        distances, index = nearest_cells(wall)
        rows, cols = np.nonzero(wall)
        nearest = np.append(cols + 1j * rows, 0.0).astype(np.complex64)[index]  # a map without walls has the index 0
        on_line = np.zeros(wall.shape, dtype=np.bool_)
        for here, there in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
            apart = np.abs(nearest[here] - nearest[there])
            # Nearest points on one curved wall are not farther apart than their distance.
            on_line[here] |= apart > np.maximum(min_apart_m / resolution, 1.2 * distances[here])
        cells = np.flatnonzero(on_line & (states.states == IS_FREE))
        free = 1.0 - pignistic(grid.masses).ravel()[cells]
        return cls(states.centres(cells), free, distances.ravel()[cells].astype(np.float64) * resolution)

    def channels(self, centre: complex, turn: float) -> list[Channel]:
        """Return its rotated cells relative to a centre, grouped by clearance."""
        points = (self.points - centre) * np.exp(1j * turn)
        kinds = np.digitize(self.clearances_m, _CLEARANCES_M) - 1
        return [(points[kinds == kind], self.probabilities[kinds == kind]) for kind in range(len(_CLEARANCES_M) - 1)]


def align(target: TbmGrid, source: TbmGrid, config: MergeConfig) -> Alignment:
    """Estimate the pose of a source grid in the target's frame; both have known cells."""
    settings = config.baselines.saeedi
    maps = CellStates.of(target), CellStates.of(source)
    placing = Placing.of(*maps)
    diagrams = [
        VoronoiDiagram.of(grid, states, settings.min_apart_m)
        for grid, states in zip((target, source), maps, strict=True)
    ]
    if min(len(diagram.points) for diagram in diagrams) == 0 or not all(
        (side.states == IS_WALL).any() for side in maps
    ):
        return Alignment("saeedi", accepted=False, reason="a map has no walls that face each other")
    places = _proposals(diagrams[0], diagrams[1], placing, settings)
    fields = _fields(diagrams[0], target.geometry, settings.cell_m)
    kinds = diagrams[1].channels(0.0, 0.0)

    def score(places: FloatArray) -> FloatArray:
        return np.asarray(
            sum(
                field.at(placing.into_target(points, places)) @ free
                for field, (points, free) in zip(fields, kinds, strict=True)
            ),
            dtype=np.float64,
        )

    places = climb(score, places, 2.0 * target.geometry.resolution, 0.01)
    place = places[score(places).argmax()]
    gain = 1.0 - float(Agreement.of(*maps, placing, place[None]).index()[0])
    criterion = f"the entropy decreases in {gain:.0%} of the overlapping cells, accepted from {settings.min_gain:.0%}"
    return judged_alignment("saeedi", maps, placing, place, (criterion, gain >= settings.min_gain), config)


def _proposals(target: VoronoiDiagram, source: VoronoiDiagram, placing: Placing, settings: SaeediConfig) -> FloatArray:
    """Return the placements (K, 3) with the largest overlap of the diagrams."""
    spectra = [
        hough_spectrum(diagram.points, diagram.probabilities, settings.cell_m / 2.0) for diagram in (target, source)
    ]
    search = ShiftSearch.over(target.channels(placing.target_centre, 0.0), placing.reach_m, settings.cell_m)
    turns = likely_turns(spectra[0], spectra[1], settings.turns).tolist()
    return search.placements(
        turns, lambda turn: source.channels(placing.source_centre, turn), settings.peaks, _FINALISTS
    )


def _fields(diagram: VoronoiDiagram, geometry: GridGeometry, blur_m: float) -> list[CellField]:
    """Return a blurred image (rows, cols) of the diagram for each interval of clearance."""
    images = []
    for points, free in diagram.channels(0.0, 0.0):
        image = np.zeros((geometry.rows, geometry.cols), dtype=np.float32)
        rows = ((points.imag - geometry.origin_y) / geometry.resolution).astype(np.intp)
        cols = ((points.real - geometry.origin_x) / geometry.resolution).astype(np.intp)
        image[rows, cols] = free
        images.append(CellField.of(cv2.GaussianBlur(image, (0, 0), blur_m / geometry.resolution), geometry))
    return images
