"""Trehard et al.: the consistency of two maps is the committed mass of their disjunction.

G. Trehard, Z. Alsayed, E. Pollard, B. Bradai, F. Nashashibi, "Credibilist simultaneous localization and mapping with a
lidar", IROS 2014, match a scan with a map in this way. Cells hold masses of the Transferable Belief Model. The
disjunction of two beliefs has the mass m(A) = m1(A) m2(A) for free and for occupied. The rest is unknown. The rule
`conjunctive` fuses cells.

Choices of this project: A map is matched instead of a scan. The maximised score is the disjunction's mass on occupied,
over the walls of both maps. All rotations and shifts are tried by correlation on coarse cells. The best poses are
refined by hill climbing on the maps' own cells, with all walls widened by a cell. The consistency is the score as a
share of the occupied mass of either map in cells that the other map knows.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from merging.alignment import Alignment
from merging.baselines.cell_states import IS_WALL, CellField, CellStates, Field, Points, evenly
from merging.baselines.placing import Placing, ShiftSearch, climb, judged_alignment
from merging.config import MergeConfig, TrehardConfig
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import FloatArray


def align(target: TbmGrid, source: TbmGrid, config: MergeConfig) -> Alignment:
    """Estimate the pose of a source grid in the target's frame; both have known cells."""
    settings = config.baselines.trehard
    maps = CellStates.of(target), CellStates.of(source)
    sides = _Side.of(target, maps[0], settings.sample), _Side.of(source, maps[1], settings.sample)
    if min(len(side.walls) for side in sides) == 0:
        return Alignment("trehard", accepted=False, reason="a map has no walls")
    placing = Placing.of(*maps)

    def sums(places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the disjunction's mass on occupied, and its largest possible value (K,)."""
        forth, back = placing.into_target(sides[1].walls, places), placing.into_source(sides[0].walls, places)
        met = [sides[0].meet(forth, sides[1].masses), sides[1].meet(back, sides[0].masses)]
        return met[0][0] + met[1][0], met[0][1] + met[1][1]

    places = _proposals(sides, placing, settings)
    places = climb(lambda places: sums(places)[0], places, 0.2, np.pi / settings.turns)
    place = places[sums(places)[0].argmax()]
    agreed, possible = (float(sums_of_both[0]) for sums_of_both in sums(place[None]))
    consistency = agreed / possible if possible > 0.0 else 0.0
    criterion = f"consistency {consistency:.2f}, accepted from {settings.min_consistency:g}"
    return judged_alignment(
        "trehard", maps, placing, place, (criterion, consistency >= settings.min_consistency), config
    )


@dataclass(frozen=True)
class _Side:
    """A map: some of its walls with normalised masses, and the masses of all cells for the comparison."""

    walls: Points
    masses: Field
    occupied: CellField
    committed: CellField

    @classmethod
    def of(cls, grid: TbmGrid, states: CellStates, sample: int) -> "_Side":
        cells = evenly(states.states == IS_WALL, sample)
        grid_masses = grid.masses
        occupied = np.ascontiguousarray(grid_masses[..., OCCUPIED])
        masses = occupied.ravel()[cells]
        wide = np.asarray(cv2.dilate(occupied, np.ones((3, 3), np.uint8)), dtype=np.float32)
        committed = np.maximum(wide, 1.0 - grid_masses[..., UNKNOWN])
        fields = (CellField.of(values, grid.geometry) for values in (wide, committed))
        return cls(states.centres(cells), masses / max(float(masses.sum()), 1e-9), *fields)

    def meet(self, points: Points, masses: Field) -> tuple[FloatArray, FloatArray]:
        """Compare the other map's walls (K, N) with this map: mass on occupied in both, and known cells of this map."""
        agreed, possible = (field.at(points) @ masses for field in (self.occupied, self.committed))
        return np.asarray(agreed, dtype=np.float64), np.asarray(possible, dtype=np.float64)


def _proposals(sides: tuple[_Side, _Side], placing: Placing, settings: TrehardConfig) -> FloatArray:
    """Return the placements (K, 3) with most common walls on coarse cells."""
    target, source = sides
    cell = max(2.0 * placing.reach_m / settings.cells_along, target.occupied.geometry.resolution)
    search = ShiftSearch.over([(target.walls - placing.target_centre, target.masses)], placing.reach_m, cell)
    turns = (2.0 * np.pi * np.arange(settings.turns) / settings.turns).tolist()
    walls = source.walls - placing.source_centre
    return search.placements(
        turns, lambda turn: [(walls * np.exp(1j * turn), source.masses)], settings.peaks, settings.finalists
    )
