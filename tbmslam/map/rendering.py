"""Scans become the grid of a map: one by one during a drive, or all keyframes at their final poses."""

import logging
import math
from collections.abc import Iterator, Sequence
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from tbmslam.belief.evidence_grid import EvidenceGrid, GridTooLargeError
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import Masses
from tbmslam.belief.tiled_masses import SIDE, TiledMasses, sparse_zeros
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray, IntArray
from tbmslam.kernels.rays.counting import MOST_SCANS, Counts, beam_ends, count_scans, counted_tiles, write_tiles
from tbmslam.kernels.rays.insertion import BeamFactors, beams_of_scan, insert_beams
from tbmslam.kernels.rays.lattice import Lattice
from tbmslam.kernels.surfels.surfels import extent
from tbmslam.machine_memory import machine_memory
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors

logger = logging.getLogger(__name__)


class InsertionConfig(FrozenConfig):
    """Which beams enter the map."""

    PUBLIC: ClassVar = ("max_range", "no_return")

    max_range: float = Field(
        float("inf"), gt=0, description="a hit beyond this range marks free space up to the range, and no obstacle [m]"
    )
    no_return: Literal["free", "ignore"] = Field(
        "ignore", description="a beam without a return marks free space up to its range limit, or nothing"
    )
    once_per_scan: bool = Field(
        False, description="each scan counts once per cell, and a hit overrides passages; else every beam counts"
    )

    @field_validator("max_range", mode="before")
    @classmethod
    def _without_limit(cls, value: object) -> object:
        """Return infinity for null, by which JSON expresses it."""
        return math.inf if value is None else value


class ScanInserter:
    """Inserts scans taken at known poses; every beam counts."""

    def __init__(self, sensor_model: SensorModelConfig, config: InsertionConfig) -> None:
        self._sensor_model = sensor_model
        self._config = config
        self._factors: dict[tuple[float, float], BeamFactors] = {}

    def insert(self, scan: LaserScan, T_map_sensor: SE2, grid: EvidenceGrid, scan_quality: float = 1.0) -> None:
        """Insert a scan of the laser at `T_map_sensor` into a grid, which grows as needed.

        `scan_quality` in [0, 1] is the weight of the evidence of every beam.
        """
        limit, no_return = self._config.max_range, self._config.no_return
        starts, ends, is_hit, corners = beams_of_scan(
            scan.ranges,
            (scan.angle_min, scan.angle_increment),
            scan.beam_step,
            T_map_sensor,
            (limit, min(limit, scan.range_max)),
            no_return == "free",
        )
        if not len(ends):
            return
        grid.grow_to_contain(corners)
        insert_beams(grid.ratios, grid.lattice, starts, ends, is_hit, self._factors_for(grid.resolution, scan_quality))

    def _factors_for(self, resolution: float, scan_quality: float) -> BeamFactors:
        key = (resolution, scan_quality)
        if key not in self._factors:
            self._factors[key] = beam_factors(self._sensor_model, resolution, scan_quality)
        return self._factors[key]


class MapConfig(FrozenConfig):
    """Parameters of the grid and of the insertion of beams."""

    PUBLIC: ClassVar = ("resolution", "max_cells", "keep_conflict")

    resolution: float = Field(0.05, ge=0.001, le=10.0, description="side of a cell [m]")
    max_cells: int = Field(
        60_000_000,
        ge=1000,
        description=(
            "largest number of cells; a larger map gets coarser cells, and a grid that grows during the "
            "drive ends with an error; a seen cell takes 24 bytes while it is rendered and 16 afterwards"
        ),
    )
    # A beam with evidence for both contradicts itself, so that many equal beams would fill a cell with conflict.
    sensor_model: SensorModelConfig = SensorModelConfig(
        hit_probability=1.0, hit_quality=0.274, miss_probability=0.0, miss_quality=0.096, wall_blur=0.0
    )
    insertion: InsertionConfig = InsertionConfig(once_per_scan=True)
    keep_conflict: bool = Field(True, description="keep the conflict of hits and misses as the fourth mass")

    @model_validator(mode="after")
    def _check_once_per_scan(self) -> Self:
        if self.insertion.once_per_scan and self.sensor_model.wall_blur > 0.0:
            raise ValueError("sensor_model.wall_blur must be 0 with insertion.once_per_scan")
        if self.insertion.once_per_scan and self.sensor_model.combination == "mean":
            raise ValueError("sensor_model.combination must be 'conjunctive' with insertion.once_per_scan")
        return self


_SCANS_AT_ONCE = 1000
_BEAMS_KEPT = 2_000_000  # number of beams whose ends are stored until they are counted; they take 34 MB
_LARGE_BYTES = 1 << 28
_STRIP_BYTES = 1 << 27
"""Counts of more than 268 MB, for 34 million cells, are taken in strips of 134 MB. Scans at the edges of strips are
counted twice, and strips take small pages, which costs a tenth more time."""
_BYTES_A_CELL = 24  # counts and masses, if all cells are seen; to save a map takes less


def render(drives: Sequence[Keyframes], config: MapConfig) -> TbmGrid:
    """Return the smallest grid that contains all cells that the keyframes saw.

    If it exceeded `max_cells`, its cells are a multiple of the resolution. If every beam counts, the grid grows scan by
    scan, and cannot exceed `max_cells`: this raises a `GridTooLargeError`, as does a lack of memory. Raises a
    `ValueError` if there are more than two million keyframes.
    """
    number = sum(map(len, drives))
    if number > MOST_SCANS:
        raise ValueError(f"drives must have at most {MOST_SCANS} keyframes, got {number}")
    counted = config.insertion.once_per_scan
    return _from_counts(drives, config) if counted else _from_beams(drives, config)


def _from_beams(drives: Sequence[Keyframes], config: MapConfig) -> TbmGrid:
    """Insert scan by scan; every beam counts."""
    grid = EvidenceGrid(config.resolution, config.max_cells)
    inserter = ScanInserter(config.sensor_model, config.insertion)
    for keyframes in drives:
        for index in range(len(keyframes)):
            inserter.insert(keyframes.scan(index), keyframes.sensor_pose(index), grid)
    return grid.to_tbm_grid(config.keep_conflict).cropped_to_known()


def _from_counts(drives: Sequence[Keyframes], config: MapConfig) -> TbmGrid:
    """Count the scans that see each cell: if each scan counts once per cell, the counts determine the masses."""
    lasers = [keyframes.all_sensor_poses() for keyframes in drives]
    blocks = _AllBlocks(drives, lasers, config)
    corners = [_corners(block) for block in blocks]
    if not corners:
        return EvidenceGrid(config.resolution).to_tbm_grid()
    geometry = _geometry_around(np.vstack(corners), config)
    resolution = geometry.resolution
    first_row, first_col = round(geometry.origin_y / resolution), round(geometry.origin_x / resolution)
    lattice, masses = Lattice(resolution, first_row - 1, first_col - 1), TiledMasses(geometry.rows, geometry.cols)
    for strip in _strips(geometry):
        counts = _counts(blocks, strip, geometry, lattice)
        masses.put_tiles(*_tiles(counts, strip.start // SIDE, sum(map(len, drives)), config, resolution))
    return TbmGrid(geometry, masses)


def _strips(geometry: GridGeometry) -> list[range]:
    """Return the rows of a grid in strips whose counts are taken one after another, to limit the memory."""
    rows, row_bytes = geometry.rows, 8 * (geometry.cols + 2)
    if rows * row_bytes <= _LARGE_BYTES:
        return [range(rows)]
    height = max(_STRIP_BYTES // row_bytes // SIDE, 1) * SIDE
    return [range(top, min(top + height, rows)) for top in range(0, rows, height)]


def _counts(blocks: "_AllBlocks", strip: range, geometry: GridGeometry, lattice: Lattice) -> Counts:
    """Return the counts (rows, cols) of a strip of a grid, whose first cell is the second of the lattice."""
    # The rows of other strips stay untouched but near the edges, so they take little memory.
    counts: Counts = sparse_zeros((geometry.rows + 2, geometry.cols + 2), np.int64, _LARGE_BYTES)
    first, last, spoken = strip.start + 1, strip.stop + 1, 0
    for block in blocks:
        seen = block if len(strip) == geometry.rows else block.some(_touches(block, first, last, lattice))
        count_scans(counts, lattice, seen.lasers, seen.ends, seen.is_hit, seen.offsets, spoken)
        spoken += len(seen.lasers)
    return counts[first:last, 1:-1]


def _touches(block: "_Block", first: int, last: int, lattice: Lattice) -> BoolArray:
    """Return which scans (K,) see a row of the lattice from `first` up to, and without, `last`."""
    touches = np.diff(block.offsets) > 0
    heights, starts, lasers = block.ends[:, 1], block.offsets[:-1][touches], block.lasers[touches, 1]
    low, high = (
        np.floor(extreme(extreme.reduceat(heights, starts), lasers) / lattice.resolution) - lattice.first_row
        for extreme in (np.minimum, np.maximum)
    )
    touches[touches] = (low < last) & (high >= first)
    return touches


class _Block(NamedTuple):
    """Some scans: the poses of their lasers, and the ends of their beams."""

    lasers: FloatArray
    ends: FloatArray
    is_hit: BoolArray
    offsets: IntArray

    def some(self, chosen: BoolArray) -> "_Block":
        """Return some of the scans (K,)."""
        sizes = np.diff(self.offsets)
        beams, offsets = np.repeat(chosen, sizes), np.concatenate(([0], np.cumsum(sizes[chosen])))
        return _Block(self.lasers[chosen], self.ends[beams], self.is_hit[beams], offsets)


class _AllBlocks:
    """The scans of drives for several passes; the scans of a short drive are stored."""

    def __init__(self, drives: Sequence[Keyframes], lasers: Sequence[FloatArray], config: MapConfig) -> None:
        self._drives, self._lasers, self._config = drives, lasers, config
        is_short = sum(len(keyframes.ranges) for keyframes in drives) <= _BEAMS_KEPT
        self._made = [*self._each()] if is_short else None

    def __iter__(self) -> Iterator[_Block]:
        return self._each() if self._made is None else iter(self._made)

    def _each(self) -> Iterator[_Block]:
        for keyframes, lasers in zip(self._drives, self._lasers, strict=True):
            yield from _blocks(keyframes, lasers, self._config)


def _blocks(keyframes: Keyframes, lasers: FloatArray, config: MapConfig) -> Iterator[_Block]:
    """Yield the scans that see any cell in blocks, since the ends of all beams would take much memory."""
    limit, clears = config.insertion.max_range, config.insertion.no_return == "free"
    for first in range(0, len(keyframes), _SCANS_AT_ONCE):
        scans = slice(first, first + _SCANS_AT_ONCE)
        offsets = keyframes.offsets[first : first + _SCANS_AT_ONCE + 1]
        ends, is_hit, begins = beam_ends(
            keyframes.ranges[offsets[0] : offsets[-1]],
            offsets - offsets[0],
            keyframes.beams[scans],
            keyframes.beam_steps[scans],
            lasers[scans],
            limit,
            clears,
        )
        if len(ends):
            yield _Block(lasers[scans], ends, is_hit, begins)


def _corners(block: _Block) -> FloatArray:
    """Return the lower and the upper corner (2, 2) of the bounding box of all cells that some scans see."""
    lasers = block.lasers[np.diff(block.offsets) > 0, :2]
    # A kernel takes a twentieth of NumPy's time along this axis.
    spans = np.array([extent(np.ascontiguousarray(lasers)), extent(block.ends)])
    return np.array([spans[:, ::2].min(axis=0), spans[:, 1::2].max(axis=0)])


def _geometry_around(points: FloatArray, config: MapConfig) -> GridGeometry:
    """Return the cells that contain all points (N, 2), larger by a whole factor if there would be too many."""
    low, high = points.min(axis=0), points.max(axis=0)
    times = max(1, math.floor(math.sqrt(float(np.prod(high - low)) / config.max_cells) / config.resolution))
    while _cells(low, high, times * config.resolution) > config.max_cells:
        times += 1
    resolution = times * config.resolution
    if times > 1:
        logger.warning(
            "the map spans %.0f x %.0f m: rendered with cells of %g m instead of %g m, to stay within the %d cells "
            "of map.max_cells",
            *(high - low),
            resolution,
            config.resolution,
            config.max_cells,
        )
    needed, there = _BYTES_A_CELL * _cells(low, high, resolution), machine_memory()
    if needed > there:
        raise GridTooLargeError(
            "the map spans {:.0f} x {:.0f} m and takes {:.1f} GB to render, more than the {:.1f} GB available: use a "
            "smaller map.max_cells or a coarser map.resolution".format(*(high - low), needed / 1e9, there / 1e9)
        )
    (left, bottom), (right, top) = (np.floor(corner / resolution).astype(int) for corner in (low, high))
    rows, cols = int(top - bottom + 1), int(right - left + 1)
    return GridGeometry(resolution, float(left) * resolution, float(bottom) * resolution, rows, cols)


def _cells(low: FloatArray, high: FloatArray, resolution: float) -> int:
    rows_and_cols = np.floor(high / resolution) - np.floor(low / resolution) + 1.0
    return math.prod(rows_and_cols.astype(int).tolist())


def _tiles(counts: Counts, first: int, most: int, config: MapConfig, resolution: float) -> tuple[IntArray, Masses]:
    """Return the places (N, 2) and the masses (N, SIDE, SIDE, 4) of all tiles of a grid that were seen in a strip.

    `counts` (rows, cols) are those of the strip, of at most `most` scans; `first` is the row of its first tile.
    """
    factors, numbers = beam_factors(config.sensor_model, resolution, 1.0), np.arange(most + 1.0)[:, None]
    # Evidence beyond this floor is certain; the masses' quotients must not become 0 / 0.
    hit, miss = (np.maximum(factor[None, :] ** -numbers, 1e-150) for factor in (factors.hit, factors.miss))
    rows, cols = counts.shape
    found = np.zeros((-(-rows // SIDE), -(-cols // SIDE)), dtype=np.bool_)
    counted_tiles(counts, SIDE, found)
    places = np.argwhere(found)
    tiles = np.empty((len(places), SIDE, SIDE, 4), dtype=np.float32)
    write_tiles(counts, places, hit, miss, config.keep_conflict, tiles)
    places[:, 0] += first
    return places, tiles
