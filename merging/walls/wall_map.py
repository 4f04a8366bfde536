"""What a map says for certain: its walls, which way they face, and its free space."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from merging.config.registration import StructureConfig
from merging.walls.movable_objects import BoolArray, Components, steadiness
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import FloatArray
from tbmslam.map.walls import Walls

_MOVABLE = 0.5
"""What counts less than this is a thing."""
_MANY_CELLS = 4000
"""Known cells that are enough to measure an overlap."""
_FLAT = 0.1
"""Slope of the blurred contrast [1/cell] under which neither side of a wall is the free one; a plain wall's is 0.5."""


@dataclass(frozen=True)
class WallMap:
    """Walls and free space of a grid, ready to be compared with another's.

    A map learns free space slower than walls (vinySLAM: m(free) = 0.23 after a hundred passages), so a cell is free
    or a wall by which of the two has more mass, not by how much. Only the surface of a wall is kept, the cells that
    touch free space: the far side of a thick wall was seen by nobody.

    Parameters
    ----------
    geometry
        The grid's cells.
    points
        Centres of the surface cells (N, 2) [m].
    normals
        Unit vectors (N, 2) from the wall into the free space.
    two_sided
        Which surface cells (N,) have free space on both sides, so that their normals might as well point backwards.
    known, free
        Which cells (rows, cols) hold evidence, and evidence for being free.
    distances_m
        From every cell (rows, cols) to the nearest surface cell [m]; inf where there is none.
    nearest
        The index in `points` of that surface cell (rows, cols).
    weights
        How much each surface cell (N,) counts: things that people move, little; see `merging.walls.movable_objects`.
    """

    geometry: GridGeometry
    points: FloatArray
    normals: FloatArray
    two_sided: BoolArray
    known: BoolArray
    free: BoolArray
    distances_m: npt.NDArray[np.float32]
    nearest: npt.NDArray[np.int32]
    weights: FloatArray

    @classmethod
    def from_grid(cls, grid: TbmGrid, config: StructureConfig) -> "WallMap":
        """Find walls and free space of a grid."""
        free_mass, wall_mass = grid.masses[..., FREE], grid.masses[..., OCCUPIED]
        free = free_mass > wall_mass
        walls = (wall_mass > free_mass) & (wall_mass >= config.min_wall_mass)
        walls = Components.of(walls).at_least(config.min_speck_m / grid.geometry.resolution).labels > 0
        surface = walls & (cv2.dilate(free.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
        normals, two_sided = _normals(free, walls, surface)
        distances, nearest = _nearest_surface(surface)
        g = grid.geometry
        return cls(
            geometry=g,
            points=g.centres_of(*np.nonzero(surface)),
            normals=normals,
            two_sided=two_sided,
            known=grid.is_known(),
            free=free,
            distances_m=(distances * g.resolution).astype(np.float32),
            nearest=nearest,
            weights=steadiness(walls, free, surface, g.resolution, config),
        )

    @cached_property
    def walls(self) -> Walls:
        """The same as the kernels take it."""
        states = np.where(self.free, np.uint8(1), np.where(self.known, np.uint8(2), np.uint8(0)))
        g = self.geometry
        return Walls(
            np.ascontiguousarray(self.points),
            np.ascontiguousarray(self.normals),
            self.two_sided,
            self.weights,
            self.distances_m,
            self.nearest,
            np.ascontiguousarray(states),
            float(g.resolution),
            float(g.origin_x),
            float(g.origin_y),
        )

    @property
    def wall_m(self) -> float:
        """Length of all walls, by how much they count [m]."""
        return float(self.weights.sum()) * self.geometry.resolution

    @cached_property
    def centroid(self) -> FloatArray:
        """Mean of the wall points (2,) [m]; the frame's origin where there is no wall."""
        return np.asarray(self.points.mean(axis=0)) if len(self.points) else np.zeros(2)

    @cached_property
    def things(self) -> tuple[Walls, npt.NDArray[np.int64]]:
        """The surface cells as they are, no less for being movable, and the indices (K,) of those that are."""
        return self.walls._replace(weights=np.ones_like(self.weights)), np.flatnonzero(self.weights < _MOVABLE)

    @cached_property
    def some_known(self) -> tuple[FloatArray, float]:
        """Centres (K, 2) of known cells, evenly chosen and enough to measure an overlap; the area of each [m^2]."""
        cells: npt.NDArray[np.intp] = np.flatnonzero(self.known)
        every = max(len(cells) // _MANY_CELLS, 1)
        rows, cols = np.divmod(cells[::every], self.geometry.cols)
        step = self.geometry.resolution
        return self.geometry.centres_of(rows, cols), step**2 * len(cells) / max(len(rows), 1)

    def some(self, limit: int | None) -> npt.NDArray[np.int64]:
        """Return the indices of at most so many surface cells, spread evenly; of all of them if None."""
        count = len(self.points)
        if limit is None or count <= limit:
            return np.arange(count)
        return np.linspace(0, count - 1, limit).astype(np.int64)


def without_walls(target: WallMap, source: WallMap) -> str | None:
    """Return in words which of two maps holds no wall, so that their relative pose is unknown; None where both do."""
    bare = [name for name, walls in (("target", target), ("source", source)) if not len(walls.points)]
    if not bare:
        return None
    return "neither map holds a wall" if len(bare) == 2 else f"the {bare[0]} map holds no wall"


def _normals(free: BoolArray, walls: BoolArray, surface: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the directions (N, 2) from surface cells into free space, and where it lies on both sides (N,)."""
    sharp = free.astype(np.float32) - walls.astype(np.float32)
    contrast = np.asarray(cv2.GaussianBlur(sharp, (0, 0), 1.5), dtype=np.float32)
    gradient = _derivatives(contrast, ((1, 0), (0, 1)), surface)
    steepness = np.linalg.norm(gradient, axis=1)
    # In the middle of a thin wall the slopes of its sides cancel; its curvature still tells how it runs.
    two_sided = steepness < _FLAT
    xx, xy, yy = _derivatives(contrast, ((2, 0), (1, 1), (0, 2)), surface).T
    across = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    axes = np.column_stack((np.cos(across), np.sin(across)))
    return np.where(two_sided[:, None], axes, gradient / np.maximum(steepness, _FLAT)[:, None]), two_sided


def _derivatives(
    contrast: npt.NDArray[np.float32], orders: tuple[tuple[int, int], ...], surface: BoolArray
) -> FloatArray:
    """Return derivatives of the given orders along x and y at the surface cells (N, len(orders))."""
    columns = [cv2.Sobel(contrast, cv2.CV_32F, *order, scale=0.125)[surface] for order in orders]
    return np.column_stack(columns).astype(np.float64)


def _nearest_surface(surface: BoolArray) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Return from every cell the distance [cells] to the nearest surface cell and its index in row-major order."""
    if not surface.any():
        return np.full(surface.shape, np.inf, dtype=np.float32), np.zeros(surface.shape, dtype=np.int32)
    distances, labels = cv2.distanceTransformWithLabels(
        (~surface).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    index_of_label = np.zeros(labels.max() + 1, dtype=np.int32)
    index_of_label[labels[surface]] = np.arange(np.count_nonzero(surface), dtype=np.int32)
    return np.asarray(distances, dtype=np.float32), index_of_label[labels]
