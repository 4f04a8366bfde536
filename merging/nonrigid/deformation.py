"""How a map is bent that lies on another tile by tile: where each of its points belongs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from merging.walls.wall_map import WallMap
from tbmslam.belief.grid import GridGeometry, Masses, TbmGrid
from tbmslam.belief.masses import UNKNOWN
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle

_STEP = 8
"""At every so many cells it is asked where they come from; between them that changes evenly."""
_BAND = 256
"""So many rows of cells are drawn at once."""
_ROUNDS = 8
"""Steps in which that is found; each leaves a tenth of the error, or as much as a metre of way is bent by."""


@dataclass(frozen=True)
class Deformation:
    """Where a bent map's points belong: a mean of what the tiles near by say, the nearer the more.

    Parameters
    ----------
    centroids
        The tiles' centroids (N, 2), in the map's frame [m].
    motions
        T_target_source as each of them has it.
    reach_m
        How far a tile has a say, a standard deviation [m].
    """

    centroids: FloatArray
    motions: Sequence[SE2]
    reach_m: float

    @classmethod
    def none(cls, T_target_source: SE2) -> "Deformation":
        """Return that of a map which is not bent."""
        return cls(np.zeros((1, 2)), [T_target_source], 1.0)

    @classmethod
    def of(cls, tiles: Sequence[WallMap], motions: Sequence[SE2]) -> "Deformation":
        """Return what tiles say that lie at T_target_source each."""
        bounds = np.array([tile.geometry.bounds() for tile in tiles])
        centroids = np.array([tile.centroid for tile in tiles])
        return cls(centroids, motions, float((bounds[:, 2:] - bounds[:, :2]).mean()) / 2.0)

    def apply(self, points: FloatArray) -> FloatArray:
        """Return where points (K, 2) of the map belong in the target's frame."""
        shares = self._shares(points)
        return np.asarray(sum(shares[:, [i]] * motion.apply(points) for i, motion in enumerate(self.motions)))

    def motion_at(self, point: FloatArray) -> SE2:
        """Return T_target_source as it is near a point (2,) of the map."""
        shares = self._shares(point[None])[0]
        turns = np.array([motion.theta for motion in self.motions])
        theta = math.atan2(float(shares @ np.sin(turns)), float(shares @ np.cos(turns)))
        x, y = self.apply(point[None])[0] - SE2(0.0, 0.0, theta).apply(point)
        return SE2(float(x), float(y), theta)

    def rigid(self) -> tuple[SE2, float, float]:
        """Return the rigid motion nearest to it, and how far tiles are from it, root mean squares [m], [rad]."""
        laid = self.apply(self.centroids)
        # Tiles in a row do not tell how the map is turned as well as they tell it themselves.
        around = np.array([(0.0, 0.0), (self.reach_m, 0.0), (0.0, self.reach_m)])
        before = np.vstack([centroid + around for centroid in self.centroids])
        after = np.vstack(
            [m.apply(centroid + around) for centroid, m in zip(self.centroids, self.motions, strict=True)]
        )
        motion = fit_rigid(after, before)[0]
        apart = np.linalg.norm(motion.apply(self.centroids) - laid, axis=1)
        turned = [wrap_angle(one.theta - motion.theta) for one in self.motions]
        return motion, float(np.sqrt(np.mean(apart**2))), float(np.sqrt(np.mean(np.square(turned))))

    def scale(self) -> tuple[float, float]:
        """Return the scale that brings the tiles' centroids nearest to where they belong, and how much of it that is.

        The latter is the share of the squared distances that a rigid motion leaves and the scale removes; 0 with fewer
        than three tiles, of which any two fit at some scale.
        """
        if len(self.centroids) < 3:
            return 1.0, 0.0
        laid = np.array([m.apply(centroid) for centroid, m in zip(self.centroids, self.motions, strict=True)])
        motion, scale = fit_rigid(laid, self.centroids)
        rigid = motion.apply(self.centroids) - laid.mean(axis=0)
        left, left_scaled = (float(((factor * rigid + laid.mean(axis=0) - laid) ** 2).sum()) for factor in (1.0, scale))
        return scale, 1.0 - left_scaled / left if left > 0.0 else 0.0

    def inverse(self) -> "Deformation":
        """Return where points of the target belong in this map."""
        centroids = np.array([m.apply(centroid) for centroid, m in zip(self.centroids, self.motions, strict=True)])
        return Deformation(centroids, [motion.inverse() for motion in self.motions], self.reach_m)

    def then(self, bend: "Deformation") -> "Deformation":
        """Return where its points belong once the target is bent, too."""
        motions = [
            bend.motion_at(m.apply(centroid)) @ m for centroid, m in zip(self.centroids, self.motions, strict=True)
        ]
        return Deformation(self.centroids, motions, self.reach_m)

    def seen_from(self, T_target_other: SE2, T_source_new: SE2) -> "Deformation":
        """Return the same of another target, and of the map in another frame of its own."""
        here = T_target_other.inverse()
        motions = [here @ motion @ T_source_new for motion in self.motions]
        return Deformation(T_source_new.inverse().apply(self.centroids), motions, self.reach_m)

    def straightened(self, grid: TbmGrid, T_target_source: SE2) -> TbmGrid:
        """Return the map in its own frame once it is bent so that a rigid motion lays it onto the target."""
        T_source_target = T_target_source.inverse()
        geometry = _covering(T_source_target.apply(self.apply(_lattice(grid.geometry))), grid)
        masses = np.empty((geometry.rows, geometry.cols, 4), dtype=np.float32)
        for first in range(0, geometry.rows, _BAND):
            last = min(first + _BAND, geometry.rows)
            band = geometry._replace(origin_y=geometry.origin_y + first * geometry.resolution, rows=last - first)
            masses[first:last] = _read(grid, *self._cells_of(band, T_source_target, grid.geometry))
        return TbmGrid(geometry, masses)

    def _cells_of(
        self, wanted: GridGeometry, T_source_target: SE2, source: GridGeometry
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return the rows and columns (rows, cols) of the map that come to lie in the cells wanted."""
        rows, cols = (np.arange(0, size + _STEP, _STEP) for size in (wanted.rows, wanted.cols))
        there = wanted.centres_of(*(index.ravel() for index in np.meshgrid(rows, cols, indexing="ij")))
        points = there
        for _ in range(_ROUNDS):
            points = points + there - T_source_target.apply(self.apply(points))
        cells = (points - (source.origin_x, source.origin_y)) / source.resolution
        row, col = np.mgrid[: wanted.rows, : wanted.cols].astype(np.float32) / _STEP
        x, y = (
            np.floor(cv2.remap(one, col, row, cv2.INTER_LINEAR)).astype(np.int64)
            for one in cells.reshape(len(rows), len(cols), 2).astype(np.float32).transpose(2, 0, 1)
        )
        return y, x

    def _shares(self, points: FloatArray) -> FloatArray:
        """Return how much each tile has to say (K, N) at points."""
        squares = ((points[:, None] - self.centroids) ** 2).sum(axis=2)
        weights = np.exp((squares.min(axis=1, keepdims=True) - squares) / (2.0 * self.reach_m**2))
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _read(grid: TbmGrid, rows: npt.NDArray[np.int64], cols: npt.NDArray[np.int64]) -> Masses:
    """Return what cells of a grid hold (rows, cols, 4); outside of it nothing is known."""
    inside = (rows >= 0) & (rows < grid.geometry.rows) & (cols >= 0) & (cols < grid.geometry.cols)
    masses = np.zeros((*inside.shape, 4), dtype=np.float32)
    masses[..., UNKNOWN] = 1.0
    masses[inside] = grid.masses[rows[inside], cols[inside]]
    return masses


def _lattice(geometry: GridGeometry) -> FloatArray:
    """Return points all over a grid, its corners among them."""
    left, bottom, right, top = geometry.bounds()
    count = 2 + max(geometry.rows, geometry.cols) // 64
    x, y = np.meshgrid(np.linspace(left, right, count), np.linspace(bottom, top, count))
    return np.column_stack((x.ravel(), y.ravel()))


def _covering(points: FloatArray, grid: TbmGrid) -> GridGeometry:
    """Return a grid with a grid's cells, large enough for points and what lies between them."""
    g = grid.geometry
    first = np.floor((points.min(axis=0) - (g.origin_x, g.origin_y)) / g.resolution).astype(int) - _STEP
    last = np.ceil((points.max(axis=0) - (g.origin_x, g.origin_y)) / g.resolution).astype(int) + _STEP
    return GridGeometry(
        g.resolution,
        g.origin_x + float(first[0]) * g.resolution,
        g.origin_y + float(first[1]) * g.resolution,
        int(last[1] - first[1]),
        int(last[0] - first[0]),
    )
