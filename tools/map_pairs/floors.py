"""The floors that map pairs show: their names, their parts, and the pairs that are cut from them."""

import re
from collections.abc import Iterable, Iterator, Sequence

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
from tbmslam.belief.grid import TbmGrid, walls_and_free

_OF_ONE = re.compile(r"(crop_(?P<building>.+?)(_\d+)?_\d{3})|(negs_(?P<same>[a-z].*?)_\d+)")
_VARIANT = r"(part\d+)?(mir)*"  # names of parts and mirror images, which are of the same building


def floors_of(names: Iterable[str]) -> dict[str, frozenset[str]]:
    """Return the buildings of each pair, one or two, by the pair's name.

    The names of pairs of one building define the buildings: `crop_BUILDING_OVERLAP`, `crop_BUILDING_SEED_OVERLAP` and
    `negs_BUILDING_SEED`. A pair of two places shows the buildings in its name.
    """
    names = list(names)
    named = [found["building"] or found["same"] for found in map(_OF_ONE.fullmatch, names) if found]
    floors = {re.sub(_VARIANT + "$", "", _plain(building)) for building in named}
    shown = {floor: re.compile(f"-{re.escape(floor)}{_VARIANT}-") for floor in sorted(floors)}
    return {
        name: frozenset(floor for floor, pattern in shown.items() if pattern.search(f"-{_plain(name)}-"))
        for name in names
    }


def shows_part(name: str) -> bool:
    """Return whether a pair shows a part of a building, by its name."""
    return re.search(r"part\d+", name) is not None


def _plain(name: str) -> str:
    return name.replace("_", "-")


_SMALL_M = 1.0  # objects shorter than this are removed from a real floor, since a distortion adds others
_LEAST_M2, _MOST_M2 = 30.0, 250.0  # least and largest area of the parts of floors [m^2]


def floor_of_grid(name: str, grid: TbmGrid) -> Building:
    """Return the floor of a map without its small objects."""
    walls, free = walls_and_free(grid)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(walls.astype(np.uint8), connectivity=8)
    extents = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * grid.geometry.resolution
    small = walls & (extents < _SMALL_M)[labels]
    occupancy = np.full(free.shape, -1, dtype=np.int8)
    occupancy[free | small] = 0
    occupancy[walls & ~small] = 100
    return Building(name, occupancy, grid.geometry.resolution)


def variants_of(floor: Building, parts: int) -> list[Building]:
    """Return a floor, its mirror image, and `parts` parts of 30 to 250 m^2, half of which are mirrored."""
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
    """Return pairs of each building: with overlap, of two ends, with its mirror image, and with two other buildings."""
    for index, building in enumerate(buildings):
        yield from cut_pairs(building, seed + index, overlaps, draw)
        yield disjoint_pair(building, seed + index, draw)
        yield foreign_pair(building, mirrored(building), seed + index, draw)
        for step in sorted({1, len(buildings) // 2}):
            other = buildings[(index + step) % len(buildings)]
            if other.resolution == building.resolution and not _same_place(building.name, other.name):
                yield foreign_pair(building, other, seed + index + step, draw)


def _same_place(first: str, second: str) -> bool:
    """Return whether two variants, by their names, show the same building and are equally mirrored."""
    same = re.sub(_VARIANT + "$", "", first) == re.sub(_VARIANT + "$", "", second)
    return same and first.count("mir") % 2 == second.count("mir") % 2
