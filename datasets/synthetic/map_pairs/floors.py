"""Floors to cut map pairs from: those of real maps, and parts and mirror images of any floor."""

import re
from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from datasets.synthetic.map_pairs.distortion import Distortion, Draw
from datasets.synthetic.map_pairs.pairs import (
    OVERLAPS,
    Building,
    MapPair,
    cut_pairs,
    disjoint_pair,
    foreign_pair,
    mirrored,
    room_of,
)
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED

_VARIANT = re.compile(r"(part\d+)?(mir)*$")
_SMALL_M = 1.0
"""Things shorter than this are taken out of a real floor: a distortion puts its own there."""
_LEAST_M2, _MOST_M2 = 30.0, 250.0
"""Sizes of the parts that are cut out of floors."""


def floor_of_grid(name: str, grid: TbmGrid) -> Building:
    """Return the floor that a map shows, without the small things that stand about in it."""
    free = grid.masses[..., FREE] > grid.masses[..., OCCUPIED]
    walls = grid.masses[..., OCCUPIED] > grid.masses[..., FREE]
    _, labels, stats, _ = cv2.connectedComponentsWithStats(walls.astype(np.uint8), connectivity=8)
    extents = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * grid.geometry.resolution
    small = walls & (extents < _SMALL_M)[labels]
    occupancy = np.full(free.shape, -1, dtype=np.int8)
    occupancy[free | small] = 0
    occupancy[walls & ~small] = 100
    return Building(name, occupancy, grid.geometry.resolution)


def variants_of(floor: Building, parts: int) -> list[Building]:
    """Return a floor, its mirror image, and so many parts of 30 to 250 m2, every second one mirrored."""
    whole_m2 = np.count_nonzero(floor.occupancy == 0) * floor.resolution**2
    most_m2 = min(_MOST_M2, 0.7 * whole_m2)
    found = [floor, mirrored(floor)]
    if most_m2 <= _LEAST_M2:
        return found
    rng = np.random.default_rng([round(whole_m2), parts])
    for index, area_m2 in enumerate(np.exp(rng.uniform(np.log(_LEAST_M2), np.log(most_m2), parts)), start=1):
        part = room_of(floor, float(area_m2), index)
        found.append(mirrored(part) if index % 2 else part)
    return found


def pairs_of(
    buildings: Sequence[Building], seed: int, overlaps: Sequence[float] = OVERLAPS, draw: Draw = Distortion.draw
) -> Iterator[MapPair]:
    """Return pairs of every building: cut at overlaps, its two ends, itself mirrored, and two other buildings."""
    for index, building in enumerate(buildings):
        yield from cut_pairs(building, seed + index, overlaps, draw)
        yield disjoint_pair(building, seed + index, draw)
        yield foreign_pair(building, mirrored(building), seed + index, draw)
        for step in (1, len(buildings) // 2):
            other = buildings[(index + step) % len(buildings)]
            if other.resolution == building.resolution and not _same_place(building.name, other.name):
                yield foreign_pair(building, other, seed + index + step, draw)


def _same_place(first: str, second: str) -> bool:
    """Return whether two variants, by their names, show the same building and neither it in a mirror."""
    same = _VARIANT.sub("", first) == _VARIANT.sub("", second)
    return same and first.count("mir") % 2 == second.count("mir") % 2
