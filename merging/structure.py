"""What a map says for certain: its walls, which way they face, and its free space."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from merging.config import StructureConfig
from tbmslam.belief import FREE, OCCUPIED
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.se2 import FloatArray

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Structure:
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
    known, free
        Which cells (rows, cols) hold evidence, and evidence for being free.
    distances_m
        From every cell (rows, cols) to the nearest surface cell [m]; inf where there is none.
    nearest
        The index in `points` of that surface cell (rows, cols).
    """

    geometry: GridGeometry
    points: FloatArray
    normals: FloatArray
    known: BoolArray
    free: BoolArray
    distances_m: npt.NDArray[np.float32]
    nearest: npt.NDArray[np.int32]

    @classmethod
    def from_grid(cls, grid: TbmGrid, config: StructureConfig) -> "Structure":
        """Find walls and free space of a grid."""
        free_mass, wall_mass = grid.masses[..., FREE], grid.masses[..., OCCUPIED]
        free = free_mass > wall_mass
        walls = (wall_mass > free_mass) & (wall_mass >= config.min_wall_mass)
        walls = _without_specks(walls, config.min_speck_m / grid.geometry.resolution)
        surface = walls & (cv2.dilate(free.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
        normals = _normals(free, walls)
        surface &= np.linalg.norm(normals, axis=-1) > 0.0
        rows, cols = np.nonzero(surface)
        distances, nearest = _nearest_surface(surface)
        g = grid.geometry
        return cls(
            geometry=g,
            points=np.column_stack(
                (g.origin_x + (cols + 0.5) * g.resolution, g.origin_y + (rows + 0.5) * g.resolution)
            ),
            normals=normals[rows, cols],
            known=grid.is_known(),
            free=free,
            distances_m=(distances * g.resolution).astype(np.float32),
            nearest=nearest,
        )

    def cells_of(self, points: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], BoolArray]:
        """Return the rows and columns of points (N, 2) [m], clipped to the grid, and which points lie inside."""
        g = self.geometry
        cols = np.floor((points[:, 0] - g.origin_x) / g.resolution).astype(np.int64)
        rows = np.floor((points[:, 1] - g.origin_y) / g.resolution).astype(np.int64)
        inside = (rows >= 0) & (rows < g.rows) & (cols >= 0) & (cols < g.cols)
        return np.clip(rows, 0, g.rows - 1), np.clip(cols, 0, g.cols - 1), inside


def _without_specks(walls: BoolArray, min_cells: float) -> BoolArray:
    """Drop connected pieces of wall shorter than so many cells."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(walls.astype(np.uint8), connectivity=8)
    extents = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    return np.asarray(walls & (extents >= min_cells)[labels])


def _normals(free: BoolArray, walls: BoolArray) -> FloatArray:
    """Return where free space lies as seen from each cell (rows, cols, 2): unit vectors (x, y), 0 where undecided."""
    contrast = cv2.GaussianBlur(free.astype(np.float64) - walls.astype(np.float64), (0, 0), 1.5)
    slopes = np.dstack((cv2.Sobel(contrast, cv2.CV_64F, 1, 0), cv2.Sobel(contrast, cv2.CV_64F, 0, 1)))
    lengths = np.linalg.norm(slopes, axis=-1, keepdims=True)
    return np.asarray(np.divide(slopes, lengths, out=np.zeros_like(slopes), where=lengths > 1e-6))


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
