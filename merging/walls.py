"""The walls of a map with their normals and weights, and its free space."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from merging.config.registration import StructureConfig
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.grids.walls import Walls
from tbmslam.kernels.search.connected_cells import boxes_of

BoolArray = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]


class Components(NamedTuple):
    """Connected components of cells."""

    labels: Labels
    """The component of each cell (rows, cols); 0 for the background."""
    stats: Labels
    """Left, top, width, height and number of cells (K + 1, 5) of the background and of each component."""

    @classmethod
    def of(cls, cells: BoolArray, *, corners: bool = True) -> "Components":
        """Find the components of cells (rows, cols); `corners` connects cells that touch at a corner only."""
        connectivity = 8 if corners else 4
        # OpenCV's own statistics include centroids, and take twice as long as the labels.
        count, found = cv2.connectedComponents(cells.view(np.uint8), connectivity=connectivity)
        labels = np.asarray(found, dtype=np.int32)
        return cls(labels, boxes_of(labels, count))

    @property
    def sides(self) -> tuple[Labels, Labels]:
        """The widths and the heights (K + 1,) of the components [cells]."""
        return self.stats[:, cv2.CC_STAT_WIDTH], self.stats[:, cv2.CC_STAT_HEIGHT]

    def at_least(self, side: float) -> BoolArray:
        """Return the cells (rows, cols) of components of at least this width or height [cells]."""
        kept = np.maximum(*self.sides) >= side
        kept[0] = False  # the background
        return np.asarray(kept[self.labels])

    def cells_of(self, index: int) -> npt.NDArray[np.float32]:
        """Return the columns and rows (N, 2) of the cells of a component, relative to its corner."""
        left, top, width, height = self.stats[index, : cv2.CC_STAT_AREA]
        rows, cols = np.nonzero(self.labels[top : top + height, left : left + width] == index)
        return np.column_stack((cols, rows)).astype(np.float32)


def steadiness(
    walls: BoolArray, free: BoolArray, surface: BoolArray, resolution: float, config: StructureConfig
) -> FloatArray:
    """Return the weights (N,) of surface cells: 1 on long walls, `least_weight` on movable objects.

    Movable objects are short components of the walls (rows, cols). Short solid blocks, and outlines that are too small
    for a room, are movable objects even if they touch a wall. The length of an object is the longer side of the
    smallest rectangle around it, so it does not depend on the rotation.
    """
    half_gap = max(round(config.gap_m / 2.0 / resolution), 1)
    mended = _grown(walls, half_gap)
    weights = _weights_by_length(mended, surface, half_gap, resolution, config)
    things = _blocks(walls, resolution, config)[surface]
    things |= _outlines(mended, free, half_gap, resolution, config)[surface]
    return np.asarray(np.where(things, config.least_weight, weights), dtype=np.float64)


def _weights_by_length(
    mended: BoolArray, surface: BoolArray, half_gap: int, resolution: float, config: StructureConfig
) -> FloatArray:
    """Return the weights (N,) of surface cells by the length of their walls, whose gaps are mended."""
    pieces = Components.of(mended)
    sizes = _sizes(pieces, config.steady_m / resolution + 2 * half_gap) - 2 * half_gap
    ramp = (sizes * resolution - config.movable_m) / max(config.steady_m - config.movable_m, resolution)
    return np.asarray(np.clip(ramp, config.least_weight, 1.0)[pieces.labels[surface]])


def _blocks(walls: BoolArray, resolution: float, config: StructureConfig) -> BoolArray:
    """Return the cells (rows, cols) of short solid blocks."""
    square = np.ones((max(round(config.block_m / resolution), 3),) * 2, np.uint8)
    thick = cv2.morphologyEx(walls.view(np.uint8), cv2.MORPH_OPEN, square)
    blocks = Components.of(thick > 0)
    shorter = (config.movable_m + config.steady_m) / 2.0 / resolution
    small = _sizes(blocks, shorter) < shorter
    small[0] = False  # the background
    # The opening removes the corners and the rough edge of a rotated block.
    return _grown(small[blocks.labels], 1)


def _outlines(
    mended: BoolArray, free: BoolArray, half_gap: int, resolution: float, config: StructureConfig
) -> BoolArray:
    """Return the cells (rows, cols) of outlines that are too small for a room.

    An unseen inside may be the core of a wall. Therefore it must be wider than walls.
    """
    insides = Components.of(~mended, corners=False)
    widths, heights = (sides + 2 * half_gap for sides in insides.sides)
    seen = np.bincount(insides.labels[free], minlength=len(widths)) > 0.5 * insides.stats[:, cv2.CC_STAT_AREA]
    longest, narrowest = config.thing_m / resolution, np.where(seen, 0.0, config.hollow_m / resolution)
    small = (np.maximum(widths, heights) <= longest) & (np.minimum(widths, heights) >= narrowest)
    small[0] = False  # the walls
    for index in np.flatnonzero(small):
        _, sides, _ = cv2.minAreaRect(insides.cells_of(int(index)))
        small[index] = min(sides) + 1.0 + 2 * half_gap >= narrowest[index]
    return _grown(small[insides.labels], 2 * half_gap + 1)


def _grown(cells: BoolArray, by: int) -> BoolArray:
    """Return the cells (rows, cols) dilated by a distance [cells]."""
    return np.asarray(cv2.dilate(cells.view(np.uint8), np.ones((2 * by + 1,) * 2, np.uint8)), np.uint8).view(np.bool_)


def _sizes(pieces: Components, enough: float) -> FloatArray:
    """Return the longer sides (K,) of components [cells]; sides over `enough` are not exact."""
    sizes = np.maximum(*pieces.sides).astype(np.float64)
    sizes[0] = np.inf
    for index in np.flatnonzero(sizes <= 1.5 * enough):
        (_, sides, _) = cv2.minAreaRect(pieces.cells_of(int(index)))
        sizes[index] = max(sides) + 1.0
    return sizes


MOVABLE = 0.5
"""Wall points with less weight than this are movable objects."""
_MANY_CELLS = 4000
"""Number of known cells by which an overlap is measured."""
_FLAT = 0.1
"""Slope of the blurred contrast [1/cell] below which both sides of a wall are free; a wall with one free side has
0.5."""


@dataclass(frozen=True)
class WallMap:
    """Walls and free space of a grid for the comparison with another map.

    The mass of free space grows more slowly than the mass of walls (vinySLAM: m(free) = 0.23 after a hundred passages).
    Therefore the larger of the two masses decides if a cell is free or a wall, whatever its size. Only the surface of a
    wall is kept: its cells beside free space. The far side of a thick wall was not seen.
    """

    geometry: GridGeometry
    points: FloatArray
    """Centres of the surface cells (N, 2) [m]."""
    normals: FloatArray
    """Unit vectors (N, 2) from the wall into the free space."""
    two_sided: BoolArray
    """Which surface cells (N,) have free space on both sides; the sign of their normals is arbitrary."""
    states: npt.NDArray[np.uint8]
    """0 unknown, 1 free, 2 known otherwise (rows, cols)."""
    distances_m: npt.NDArray[np.float32]
    """Distance from every cell (rows, cols) to the nearest surface cell [m]; inf without walls."""
    nearest: npt.NDArray[np.int32]
    """The index in `points` of that surface cell (rows, cols)."""
    weights: FloatArray
    """Weight of each surface cell (N,), small for movable objects; see `steadiness`."""

    @classmethod
    def from_grid(cls, grid: TbmGrid, config: StructureConfig) -> "WallMap":
        """Find walls and free space of a grid."""
        free, walls = np.zeros((2, *grid.cells.shape[:2]), dtype=np.bool_)
        for rows, cols, masses in grid.pieces():
            free_mass, wall_mass = (np.ascontiguousarray(masses[..., kind]) for kind in (FREE, OCCUPIED))
            free[rows, cols] = free_mass > wall_mass
            walls[rows, cols] = (wall_mass > free_mass) & (wall_mass >= config.min_wall_mass)
        walls = Components.of(walls).at_least(config.min_speck_m / grid.geometry.resolution)
        surface = walls & _grown(free, 1)
        normals, two_sided = _normals(free, walls, surface)
        g = grid.geometry
        weights = steadiness(walls, free, surface, g.resolution, config)
        distances, nearest = nearest_cells(surface)
        distances *= np.float32(g.resolution)
        return cls(
            geometry=g,
            points=g.centres_of(*np.nonzero(surface)),
            normals=normals,
            two_sided=two_sided,
            states=np.where(free, np.uint8(1), np.where(grid.is_known(), np.uint8(2), np.uint8(0))),
            distances_m=distances,
            nearest=nearest,
            weights=weights,
        )

    @property
    def known(self) -> BoolArray:
        """Which cells (rows, cols) have evidence."""
        return np.asarray(self.states > 0)

    @property
    def free(self) -> BoolArray:
        """Which cells (rows, cols) are free."""
        return np.asarray(self.states == 1)

    @cached_property
    def walls(self) -> Walls:
        """The map in the form that the kernels take."""
        g = self.geometry
        return Walls(
            np.ascontiguousarray(self.points),
            np.ascontiguousarray(self.normals),
            self.two_sided,
            self.weights,
            self.distances_m,
            self.nearest,
            np.ascontiguousarray(self.states),
            float(g.resolution),
            float(g.origin_x),
            float(g.origin_y),
        )

    @property
    def wall_m(self) -> float:
        """Weighted length of all walls [m]."""
        return float(self.weights.sum()) * self.geometry.resolution

    @cached_property
    def centroid(self) -> FloatArray:
        """Mean of the wall points (2,) [m]; the frame's origin without walls."""
        return np.asarray(self.points.mean(axis=0)) if len(self.points) else np.zeros(2)

    @cached_property
    def things(self) -> tuple[Walls, npt.NDArray[np.int64]]:
        """The surface cells with weight 1 each, and the indices (K,) of those on movable objects."""
        return self.walls._replace(weights=np.ones_like(self.weights)), np.flatnonzero(self.weights < MOVABLE)

    @cached_property
    def some_known(self) -> tuple[FloatArray, float]:
        """Centres (K, 2) of evenly chosen known cells, by which overlaps are measured, and the area of each [m^2]."""
        cells: npt.NDArray[np.intp] = np.flatnonzero(self.known)
        every = max(len(cells) // _MANY_CELLS, 1)
        rows, cols = np.divmod(cells[::every], self.geometry.cols)
        step = self.geometry.resolution
        return self.geometry.centres_of(rows, cols), step**2 * len(cells) / max(len(rows), 1)

    def knows(self, points: FloatArray) -> BoolArray:
        """Return which points (N, 2) [m] of the map's frame lie in known cells."""
        rows, cols, inside = self.geometry.cells_at(points)
        return np.asarray(inside & (self.states[rows, cols] > 0))

    def cut(self, rows: tuple[int, int], cols: tuple[int, int]) -> "WallMap":
        """Return the part of some rows and columns, each given by its first and the one after its last.

        Walls keep their normals and weights. A cell whose nearest wall lies outside the part has no nearest wall.
        """
        part = slice(*rows), slice(*cols)
        distances, nearest = self.distances_m[part], self.nearest[part]
        kept = nearest[distances == 0.0]
        numbers = np.full(len(self.points) + 1, -1, dtype=np.int32)
        numbers[kept] = np.arange(len(kept), dtype=np.int32)
        numbered = numbers[nearest]
        return WallMap(
            geometry=self.geometry.part(*rows, *cols),
            points=self.points[kept],
            normals=self.normals[kept],
            two_sided=self.two_sided[kept],
            states=self.states[part],
            distances_m=np.where(numbered >= 0, distances, np.float32(np.inf)),
            nearest=np.maximum(numbered, 0),
            weights=self.weights[kept],
        )

    def some(self, limit: int | None) -> npt.NDArray[np.int64]:
        """Return indices of at most `limit` evenly chosen surface cells; all if None."""
        count = len(self.points)
        if limit is None or count <= limit:
            return np.arange(count)
        return np.linspace(0, count - 1, limit).astype(np.int64)


def without_walls(target: WallMap, source: WallMap) -> str | None:
    """Return which of two maps holds no wall, as text; None if both hold walls."""
    bare = [name for name, walls in (("target", target), ("source", source)) if not len(walls.points)]
    if not bare:
        return None
    return "neither map holds a wall" if len(bare) == 2 else f"the {bare[0]} map holds no wall"


def _normals(free: BoolArray, walls: BoolArray, surface: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the normals (N, 2) of surface cells, and which cells have free space on both sides (N,)."""
    derivatives = np.concatenate([_derivatives(free, walls, surface, band) for band in _bands(len(surface))])
    gradient = np.ascontiguousarray(derivatives[:, :2])
    steepness = np.linalg.norm(gradient, axis=1)
    # In the middle of a thin wall the slopes of its sides cancel. The curvature gives the direction of the wall.
    two_sided = steepness < _FLAT
    xx, xy, yy = derivatives[:, 2:].T
    across = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    axes = np.column_stack((np.cos(across), np.sin(across)))
    return np.where(two_sided[:, None], axes, gradient / np.maximum(steepness, _FLAT)[:, None]), two_sided


_BAND = 256
"""Rows of cells that are computed at once, to limit the memory."""
_AROUND = 16
"""Rows beside a band that its derivatives depend on: the filters reach 7 rows."""


def _bands(rows: int) -> list[slice]:
    return [slice(first, min(first + _BAND, rows)) for first in range(0, rows, _BAND)]


_ORDERS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""Orders along x and y of the derivatives."""


def _derivatives(free: BoolArray, walls: BoolArray, surface: BoolArray, band: slice) -> FloatArray:
    """Return the derivatives (N, 5) of the blurred contrast of free space and walls at the surface cells of a band."""
    there = surface[band]
    if not there.any():
        return np.zeros((0, len(_ORDERS)))
    first = max(band.start - _AROUND, 0)
    around, inside = slice(first, band.stop + _AROUND), slice(band.start - first, band.stop - first)
    sharp = free[around].astype(np.float32) - walls[around].astype(np.float32)
    contrast = np.asarray(cv2.GaussianBlur(sharp, (0, 0), 1.5), dtype=np.float32)
    columns = [cv2.Sobel(contrast, cv2.CV_32F, *order, scale=0.125)[inside][there] for order in _ORDERS]
    return np.column_stack(columns).astype(np.float64)


def nearest_cells(cells: BoolArray) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Return from every cell the distance [cells] to the nearest of some cells and its index in row-major order.

    Without cells, the distances are inf and the indices 0.
    """
    if not cells.any():
        return np.full(cells.shape, np.inf, dtype=np.float32), np.zeros(cells.shape, dtype=np.int32)
    distances, labels = cv2.distanceTransformWithLabels(
        (~cells).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    index_of_label = np.zeros(labels.max() + 1, dtype=np.int32)
    index_of_label[labels[cells]] = np.arange(np.count_nonzero(cells), dtype=np.int32)
    nearest = np.asarray(labels, dtype=np.int32)
    for band in _bands(len(nearest)):  # in place, since a second array of a large map takes much memory
        nearest[band] = index_of_label[nearest[band]]
    return np.asarray(distances, dtype=np.float32), nearest
