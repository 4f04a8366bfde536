"""Sets of maps of two places: several robots were at each, and none knows of the others.

Maps of one place err alike. What looks alike at the two places does so in all of their maps, so that many pairs may
agree on one false join, where strangers met two by two would be told apart.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from datasets.synthetic.map_pairs.distortion import Distortion
from datasets.synthetic.map_pairs.pairs import OVERLAPS, Building, Occupancy, explored_parts, mirrored
from tbmslam.geometry.se2 import SE2


@dataclass(frozen=True)
class PlacedMap:
    """A map, and where it is.

    Parameters
    ----------
    place
        Maps of one place belong together, others do not.
    occupancy
        Occupancy (rows, cols) in percent, -1 unknown; cell (i, j) has its centre at ((j + 0.5), (i + 0.5)) cells.
    resolution
        Side of a cell [m].
    T_map_building
        Pose of the frame of the place's building in the map's.
    """

    place: str
    occupancy: Occupancy
    resolution: float
    T_map_building: SE2


def maps_of(building: Building, count: int, rng: np.random.Generator) -> Iterator[PlacedMap]:
    """Yield maps of a building, each of all of it or of what a robot saw from one of two far ends."""
    for _ in range(count):
        parts = explored_parts(building, float(rng.choice(OVERLAPS)), rng)
        yield _spoilt(building.name, building, parts[int(rng.integers(2))], rng)


def maps_of_far_ends(building: Building, count: int, rng: np.random.Generator) -> Iterator[PlacedMap]:
    """Yield so many maps of each of two ends of a building that share nothing: alike in style, and two places."""
    for number, part in enumerate(explored_parts(building, 0.0, rng)):
        for _ in range(count):
            yield _spoilt(f"{building.name} end {number}", building, part, rng)


def maps_of_mirrored(building: Building, count: int, rng: np.random.Generator) -> Iterator[PlacedMap]:
    """Yield so many maps of a building and as many of its mirror image, which is another."""
    yield from maps_of(building, count, rng)
    yield from maps_of(mirrored(building), count, rng)


def _spoilt(place: str, building: Building, part: Occupancy, rng: np.random.Generator) -> PlacedMap:
    spoilt = Distortion.draw(rng).spoil(part, building.resolution, rng)
    return PlacedMap(place, spoilt.occupancy, building.resolution, spoilt.T_map_building)
