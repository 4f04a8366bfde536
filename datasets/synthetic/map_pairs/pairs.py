"""Pairs and sets of maps of one building whose relative poses are known."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from datasets.synthetic.buildings import make_world
from datasets.synthetic.map_pairs.distortion import DistortedMap, Distortion, Draw, Occupancy
from datasets.synthetic.world.world import CorridorLattice, World, graph_of_cells
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import SE2
from tbmslam.io.atomic_file import replacing

OVERLAPS = (1.0, 0.75, 0.5, 0.35, 0.25, 0.15)
"""Overlaps to draw from, as shares of the smaller map's free cells that both maps know."""

_STRAIGHT_M = 0.1  # deformation beyond which the relative pose is fitted in the overlap of two maps [m]
_COARSE = 4  # side of the blocks in which distances through a building are measured [cells]


@dataclass(frozen=True)
class Building:
    """A floor whose parts become maps."""

    name: str
    """Name of the building; its pairs share the name, so that a building can be held out."""
    occupancy: Occupancy
    """Occupancy (rows, cols) in percent, -1 unknown; row grows with y, column with x."""
    resolution: float
    """Side of a cell [m]."""


@dataclass(frozen=True)
class MapPair:
    """Two maps with their relative pose."""

    name: str
    """Unique name; begins with `crop` for maps of one place, with `neg` for maps of two."""
    occ_a: Occupancy
    occ_b: Occupancy
    """Occupancies (rows, cols) in percent, -1 unknown; cell (i, j) has its centre at ((j + 0.5), (i + 0.5)) cells."""
    resolution: float
    """Side of a cell [m]."""
    T_a_b: SE2 | None
    """Pose of b's frame in a's; None if the maps show different places."""
    overlap: float
    """Share of the smaller map's free cells that both know."""

    @property
    def known_m2(self) -> float:
        """Sum of the known areas of both maps [m^2]."""
        return float(sum(np.count_nonzero(cells >= 0) for cells in (self.occ_a, self.occ_b)) * self.resolution**2)

    def save(self, folder: Path) -> Path:
        """Write `<name>.npz` atomically, and return its path."""
        motion = np.full((3, 3), np.nan) if self.T_a_b is None else self.T_a_b.matrix()
        path = folder / f"{self.name}.npz"
        with replacing(path) as temporary:
            np.savez_compressed(
                temporary,
                occ_a=self.occ_a,
                occ_b=self.occ_b,
                resolution=np.array(self.resolution),
                T_ab=motion,
                label=np.array(int(self.T_a_b is not None)),
                overlap=np.array(self.overlap),
            )
        return path


def building_of_world(kind: str, seed: int, resolution: float = 0.05) -> Building:
    """Return the floor of a simulated building; see `datasets.synthetic.buildings.make_world`."""
    return _building(f"{kind}{seed}", make_world(kind, seed), resolution)


def building_of_area(area_m2: float, seed: int, resolution: float = 0.05) -> Building:
    """Return a square floor of any size: corridors between blocks with niches; see `CorridorLattice`."""
    side = area_m2**0.5
    walls = CorridorLattice(seed).walls_near((0.0, 0.0), (side, side))
    world = World("corridor lattice", seed, walls, np.array([[side / 2.0, 20.0 * (side // 40.0)]]))
    whole = _building(f"lattice{seed}", world, resolution)
    count = round(side / resolution)
    return Building(whole.name, whole.occupancy[:count, :count], resolution)


def _building(name: str, world: World, resolution: float) -> Building:
    labels = world.occupancy(world.grid(resolution))
    occupancy = np.full(labels.shape, -1, dtype=np.int8)
    occupancy[labels == FREE] = 0
    occupancy[(labels == OCCUPIED) & (ndimage.maximum_filter(labels == FREE, 3))] = 100
    return Building(name, occupancy, resolution)


def mirrored(building: Building) -> Building:
    """Return the mirror image of a building: another building of the same style and size."""
    return Building(f"{building.name}mir", building.occupancy[:, ::-1].copy(), building.resolution)


def cut_pairs(
    building: Building, seed: int, overlaps: Sequence[float] = OVERLAPS, draw: Draw = Distortion.draw
) -> Iterator[MapPair]:
    """Cut pairs of maps of one building: two robots explore it from far ends until they reach an overlap."""
    for overlap in overlaps:
        rng = np.random.default_rng([seed, round(1000 * overlap)])
        part_a, part_b = explored_parts(building, overlap, rng)
        name = f"crop_{building.name}_{seed}_{round(100 * overlap):03d}"
        yield _distorted_pair(name, building, (part_a, part_b), overlap, rng, draw)


def disjoint_pair(building: Building, seed: int, draw: Draw = Distortion.draw) -> MapPair:
    """Return maps of two disjoint ends of a building: different places of the same style."""
    rng = np.random.default_rng([seed, 1])
    parts = explored_parts(building, 0.0, rng)
    return replace(_distorted_pair(f"negs_{building.name}_{seed}", building, parts, 0.0, rng, draw), T_a_b=None)


def foreign_pair(first: Building, second: Building, seed: int, draw: Draw = Distortion.draw) -> MapPair:
    """Return maps of two buildings."""
    if first.resolution != second.resolution:
        raise ValueError(f"buildings must have one resolution, got {first.resolution} and {second.resolution}")
    rng = np.random.default_rng([seed, 2])
    part_a, _ = explored_parts(first, float(rng.choice(OVERLAPS)), rng)
    part_b, _ = explored_parts(second, float(rng.choice(OVERLAPS)), rng)
    a, b = (draw(rng).distort(part, first.resolution, rng) for part in (part_a, part_b))
    return MapPair(f"negd_{first.name}_{second.name}_{seed}", a.occupancy, b.occupancy, first.resolution, None, 0.0)


def _distorted_pair(
    name: str,
    building: Building,
    parts: tuple[Occupancy, Occupancy],
    overlap: float,
    rng: np.random.Generator,
    draw: Draw,
) -> MapPair:
    """Rotate and distort two parts of a building."""
    distortions = list[Distortion]()
    distorted = list[DistortedMap]()
    for part in parts:
        distortions.append(draw(rng))
        distorted.append(distortions[-1].distort(part, building.resolution, rng))
    a, b = distorted
    T_a_b = a.T_map_building @ b.T_map_building.inverse()
    common = np.argwhere((parts[0] >= 0) & (parts[1] >= 0))
    if max(distortion.deformation_m for distortion in distortions) > _STRAIGHT_M and len(common):
        points = (common[:, ::-1].astype(np.float64) + 0.5) * building.resolution
        T_a_b = fit_rigid(a.laid(points), b.laid(points))[0]
    return MapPair(name, a.occupancy, b.occupancy, building.resolution, T_a_b, overlap)


def explored_parts(building: Building, overlap: float, rng: np.random.Generator) -> tuple[Occupancy, Occupancy]:
    """Return the maps of two robots that drove equally far and share a part of their free cells."""
    distances_a, distances_b = _distances_from_far_ends(building.occupancy == 0, rng)
    free = np.isfinite(distances_a)  # reachable cells
    lengths = [distances[free] for distances in (distances_a, distances_b)]
    ranked = [np.sort(values) for values in lengths]
    low, high = 0.0, 1.0
    for _ in range(25):
        share = (low + high) / 2.0
        a, b = (values <= _quantile(order, share) for values, order in zip(lengths, ranked, strict=True))
        common = np.count_nonzero(a & b) / max(min(int(np.count_nonzero(a)), int(np.count_nonzero(b))), 1)
        low, high = (low, share) if common > overlap else (share, high)
    share = low if overlap < 1.0 else 1.0
    a, b = (
        distances <= _quantile(order, share)
        for distances, order in zip((distances_a, distances_b), ranked, strict=True)
    )
    return _seen(building.occupancy, a), _seen(building.occupancy, b)


def _quantile(ranked: npt.NDArray[np.float64], share: float) -> float:
    """Return a quantile of sorted numbers; numpy would sort them again."""
    whole, part = divmod(share * (len(ranked) - 1), 1.0)
    low = int(whole)
    return float(ranked[low] + (ranked[min(low + 1, len(ranked) - 1)] - ranked[low]) * part)


def _seen(occupancy: Occupancy, free: npt.NDArray[np.bool_]) -> Occupancy:
    """Return the part of a floor with given free cells and the walls around them."""
    near = ndimage.binary_dilation(free, np.ones((3, 3), np.bool_), iterations=3)
    return np.where(free | (near & (occupancy > 50)), occupancy, np.int8(-1)).astype(np.int8)


def _distances_from_far_ends(
    free: npt.NDArray[np.bool_], rng: np.random.Generator, *, from_anywhere: bool = False
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return path lengths from two distant ends to all cells (rows, cols), in blocks; inf for walls.

    With `from_anywhere` the first end is any place instead.
    """
    rows, cols = (-(-size // _COARSE) * _COARSE for size in free.shape)
    padded = np.zeros((rows, cols), dtype=np.bool_)
    padded[: free.shape[0], : free.shape[1]] = free
    blocks = np.asarray(padded.reshape(rows // _COARSE, _COARSE, cols // _COARSE, _COARSE).any(axis=(1, 3)))
    graph = graph_of_cells(blocks, np.ones(blocks.shape))
    _, regions = connected_components(graph, directed=False)
    largest = np.flatnonzero(regions == np.bincount(regions).argmax())
    somewhere = int(rng.choice(largest))
    first = somewhere if from_anywhere else _farthest(_lengths_from(graph, somewhere))
    from_first = _lengths_from(graph, first)
    from_second = _lengths_from(graph, _farthest(from_first))
    distances = []
    for lengths in (from_first, from_second):
        image = np.full(blocks.shape, np.inf)
        image[blocks] = lengths + rng.uniform(0.0, 0.5, len(lengths))
        fine = np.repeat(np.repeat(image, _COARSE, axis=0), _COARSE, axis=1)[: free.shape[0], : free.shape[1]]
        distances.append(np.where(free, fine, np.inf))
    return distances[0], distances[1]


def _lengths_from(graph: sparse.csr_array, block: int) -> npt.NDArray[np.float64]:
    lengths: npt.NDArray[np.float64] = dijkstra(graph, directed=False, indices=[block])[0]
    return lengths


def _farthest(lengths: npt.NDArray[np.float64]) -> int:
    return int(np.argmax(np.where(np.isfinite(lengths), lengths, -1.0)))


def room_of(building: Building, area_m2: float, seed: int) -> Building:
    """Return the part of a building around one place, with the given free area [m2]."""
    rng = np.random.default_rng([seed, 3])
    distances, _ = _distances_from_far_ends(building.occupancy == 0, rng, from_anywhere=True)
    cells = np.sort(distances[np.isfinite(distances)])
    reach = cells[min(int(area_m2 / building.resolution**2), len(cells) - 1)]
    part = _seen(building.occupancy, distances <= reach)
    rows, cols = np.nonzero(part >= 0)
    cut = part[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    return Building(f"{building.name}part{seed}", cut, building.resolution)


@dataclass(frozen=True)
class PlacedMap:
    """A map and its place."""

    place: str
    """Name of the place; maps of one place belong together."""
    occupancy: Occupancy
    """Occupancy (rows, cols) in percent, -1 unknown; cell (i, j) has its centre at ((j + 0.5), (i + 0.5)) cells."""
    resolution: float
    """Side of a cell [m]."""
    T_map_building: SE2
    """Pose of the building's frame in the map's."""


def maps_of(building: Building, count: int, rng: np.random.Generator) -> Iterator[PlacedMap]:
    """Yield maps of a building: of all of it, or of the part around one of two distant ends."""
    for _ in range(count):
        parts = explored_parts(building, float(rng.choice(OVERLAPS)), rng)
        yield _distorted_map(building.name, building, parts[int(rng.integers(2))], rng)


def maps_of_far_ends(building: Building, count: int, rng: np.random.Generator) -> Iterator[PlacedMap]:
    """Yield `count` maps of each of two disjoint ends of a building: two places of the same style."""
    for number, part in enumerate(explored_parts(building, 0.0, rng)):
        for _ in range(count):
            yield _distorted_map(f"{building.name} end {number}", building, part, rng)


def maps_of_mirrored(building: Building, count: int, rng: np.random.Generator) -> Iterator[PlacedMap]:
    """Yield `count` maps of a building and of its mirror image, which is another place."""
    yield from maps_of(building, count, rng)
    yield from maps_of(mirrored(building), count, rng)


def _distorted_map(place: str, building: Building, part: Occupancy, rng: np.random.Generator) -> PlacedMap:
    distorted = Distortion.draw(rng).distort(part, building.resolution, rng)
    return PlacedMap(place, distorted.occupancy, building.resolution, distorted.T_map_building)
