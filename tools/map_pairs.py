"""Map pairs and sets with known poses: their files, their floors, and the comparison of a merge with the truth."""

import itertools
import math
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from datasets.synthetic.map_pairs.distortion import Distortion, Draw
from datasets.synthetic.map_pairs.pairs import (
    OVERLAPS,
    Building,
    MapPair,
    PlacedMap,
    cut_pairs,
    disjoint_pair,
    foreign_pair,
    mirrored,
    room_of,
)
from merging.alignment import Pair
from merging.map_graph.grouping import Group
from tbmslam.belief.grid import GridGeometry, TbmGrid, masses_from_probability, walls_and_free
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.map.map_check import check_geometry
from tbmslam.map.tbm_map import TbmMap
from tbmslam.special_file import why_unreadable

_RIGHT_M, _RIGHT_DEG = 0.5, 2.0
_NEAR_DEG = 4.0


class PairFileError(TbmSlamError):
    """A file does not hold a pair of maps."""


@dataclass(frozen=True)
class KnownPair:
    """Two maps and the truth about them."""

    name: str
    target: TbmMap
    source: TbmMap
    T_target_source: SE2 | None
    """The true pose; None if the maps show different places."""
    overlap: float
    """Share of the smaller map's free cells that both know."""

    @classmethod
    def of(cls, pair: MapPair) -> "KnownPair":
        """Return a pair that was cut from a building."""
        maps = [TbmMap(grid_of(occupancy, pair.resolution)) for occupancy in (pair.occ_a, pair.occ_b)]
        return cls(pair.name, maps[0], maps[1], pair.T_a_b, pair.overlap)

    def errors(self, found: SE2) -> tuple[float, float]:
        """Return the errors of an alignment at the centre of the known part of the source [m], [deg]."""
        if self.T_target_source is None:
            raise ValueError(f"{self.name} has no true alignment")
        geometry = self.source.grid.geometry
        rows, cols = np.nonzero(self.source.grid.is_known())
        middle = geometry.centre_of(float(rows.mean()), float(cols.mean()))
        apart = np.linalg.norm(found.apply(middle) - self.T_target_source.apply(middle))
        return float(apart), abs(math.degrees(wrap_angle(found.theta - self.T_target_source.theta)))

    def is_right(self, found: SE2 | None, most_deg: float = _RIGHT_DEG) -> bool:
        """Return whether an alignment is right within 0.5 m and an angle."""
        if found is None or self.T_target_source is None:
            return False
        metres, degrees = self.errors(found)
        return metres <= _RIGHT_M and degrees <= most_deg

    def is_near(self, found: SE2 | None) -> bool:
        """Return whether an alignment is right within 0.5 m and 4 degrees, the tolerance for deformed maps."""
        return self.is_right(found, _NEAR_DEG)


def load_pair(path: Path) -> KnownPair:
    """Read a file of occupancies `occ_a`, `occ_b` [%], -1 unknown, `resolution`, `T_ab` (3, 3), `label`, `overlap`."""
    if why := "is no file but a folder" if path.is_dir() else why_unreadable(path):
        raise PairFileError(f"{path} {why}: give a folder of pairs")
    try:
        with np.load(path, allow_pickle=False) as arrays:
            resolution, label = float(arrays["resolution"]), int(arrays["label"])
            maps = [TbmMap(grid_of(arrays[key], resolution)) for key in ("occ_a", "occ_b")]
            motion = np.asarray(arrays["T_ab"], dtype=np.float64)
            overlap = float(arrays["overlap"])
    except (OSError, EOFError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise PairFileError(
            f"{path} is not a pair of maps: {error}; see datasets/synthetic/map_pairs/pairs.py"
        ) from error
    for one in maps:
        check_geometry(path, one.grid.geometry)
    faults = [one.grid.fault() for one in maps]
    if label and not (motion.shape == (3, 3) and np.isfinite(motion).all()):
        faults.append("T_ab is no finite matrix (3, 3)")
    if fault := next(filter(None, faults), None):
        raise PairFileError(f"{path} is not a pair of maps: {fault}; see datasets/synthetic/map_pairs/pairs.py")
    return KnownPair(path.stem, maps[0], maps[1], SE2.from_matrix(motion) if label else None, overlap)


def grid_of(occupancy: npt.NDArray[np.int8], resolution: float) -> TbmGrid:
    """Return a grid of an occupancy (rows, cols) in percent, -1 unknown, its corner at the origin."""
    known = occupancy >= 0
    masses = masses_from_probability(np.where(known, occupancy, 50) / 100.0, known)
    return TbmGrid(GridGeometry(resolution, 0.0, 0.0, *occupancy.shape), masses)


_OF_ONE = re.compile(r"(crop_(?P<building>.+?)(_\d+)?_\d{3})|(negs_(?P<same>[a-z].*?)_\d+)")
_VARIANT = r"(part\d+)?(mir)*"
"""Names of parts and mirror images, which are of the same building."""


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


_SMALL_M = 1.0
"""Objects shorter than this are removed from a real floor, since a distortion adds others."""
_LEAST_M2, _MOST_M2 = 30.0, 250.0
"""Least and largest area of the parts of floors [m^2]."""


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
        for step in (1, len(buildings) // 2):
            other = buildings[(index + step) % len(buildings)]
            if other.resolution == building.resolution and not _same_place(building.name, other.name):
                yield foreign_pair(building, other, seed + index + step, draw)


def _same_place(first: str, second: str) -> bool:
    """Return whether two variants, by their names, show the same building and are equally mirrored."""
    same = re.sub(_VARIANT + "$", "", first) == re.sub(_VARIANT + "$", "", second)
    return same and first.count("mir") % 2 == second.count("mir") % 2


def shuffled(placed: Sequence[PlacedMap], rng: np.random.Generator) -> dict[str, PlacedMap]:
    """Return maps in random order by names without their places."""
    return {f"map_{index}": placed[chosen] for index, chosen in enumerate(rng.permutation(len(placed)).tolist())}


def maps_by_name(placed: Mapping[str, PlacedMap]) -> dict[str, TbmMap]:
    """Return the maps by name."""
    return {name: TbmMap(grid_of(placed_map.occupancy, placed_map.resolution)) for name, placed_map in placed.items()}


def known_pair(pair: Pair, placed: Mapping[str, PlacedMap], maps: Mapping[str, TbmMap]) -> KnownPair:
    """Return a pair of maps with its true pose."""
    target, source = (placed[name] for name in pair)
    motion = target.T_map_building @ source.T_map_building.inverse() if target.place == source.place else None
    return KnownPair("-".join(pair), maps[pair[0]], maps[pair[1]], motion, 0.0)


def joined_pairs(groups: Sequence[Group]) -> dict[Pair, SE2]:
    """Return the relative pose of every two maps of a group."""
    return {
        (a, b): group.poses[a].inverse() @ group.poses[b]
        for group in groups
        for a, b in itertools.combinations(sorted(group.poses), 2)
    }
