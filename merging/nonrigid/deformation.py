"""Deformation of a map: rectangular tiles are registered rigidly one by one, and their transforms are interpolated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np

from merging.config import MergeConfig
from merging.registration.correlation import refine_all
from merging.verification import compared_and_agreed_m
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import Masses
from tbmslam.belief.tiled_masses import SIDE, TiledMasses, vacuous_masses
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import SE2, FloatArray, IntArray, wrap_angle

_STEP = 8
"""The inverse of a deformation is computed at every eighth cell and interpolated linearly between them."""
_BAND = 8 * SIDE  # rows of cells that are resampled at once, to limit the memory
_ROUNDS = 8
"""Most fixed-point iterations of the inverse. Each multiplies the error by a tenth, or by the deformation per metre."""
_EXACT = 0.01  # change of the inverse that ends its iterations [cells]
_LEAST_COMMON = 10  # least number of common cells that fix a rigid transform
_MIN_SCALE_ERROR = 0.01
"""A scale nearer to 1 than this may be the error of the tiles: cells of 5 cm over tiles of some metres."""
_MIN_SCALE_SHARE = 0.8
"""Share of the deformation that a wrong resolution explains. It is exceeded by 43 of 48 pairs of undistorted maps, one
of which was made 2 or 4 % larger, and by 1 of 130 pairs of maps that are bent by 0.3 m."""


@dataclass(frozen=True)
class Deformation:
    """A mapping of points from a source map to a target map: the mean of rigid transforms, weighted by distance."""

    centroids: FloatArray
    """Centroids of the tiles (N, 2) in the source's frame [m]."""
    motions: Sequence[SE2]
    """T_target_source of each tile."""
    reach_m: float
    """Standard deviation of the Gaussian weight of a tile over the distance from its centroid [m]."""

    @classmethod
    def of_rigid(cls, T_target_source: SE2) -> "Deformation":
        """Return a rigid transform as a deformation."""
        return cls(np.zeros((1, 2)), [T_target_source], 1.0)

    @classmethod
    def of_tiles(cls, tiles: Sequence[WallMap], motions: Sequence[SE2]) -> "Deformation":
        """Return the deformation by tiles and the T_target_source of each."""
        bounds = np.array([tile.geometry.bounds() for tile in tiles])
        centroids = np.array([tile.centroid for tile in tiles])
        return cls(centroids, motions, float((bounds[:, 2:] - bounds[:, :2]).mean()) / 2.0)

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points (K, 2) of the source to the target's frame."""
        cos, sin, x, y = self._means_at(points)
        moved = cos * points[:, 0] - sin * points[:, 1] + x, sin * points[:, 0] + cos * points[:, 1] + y
        return np.column_stack(moved)

    def motion_at(self, point: FloatArray) -> SE2:
        """Return the rigid T_target_source near a point (2,) of the source."""
        cos, sin, _, _ = self._means_at(point[None])[:, 0]
        theta = math.atan2(float(sin), float(cos))
        x, y = self.apply(point[None])[0] - SE2(0.0, 0.0, theta).apply(point)
        return SE2(float(x), float(y), theta)

    def _means_at(self, points: FloatArray) -> FloatArray:
        """Return the weighted means (4, K) of the tiles' cosines, sines and shifts at points (K, 2)."""
        entries = np.array([(math.cos(m.theta), math.sin(m.theta), m.x, m.y) for m in self.motions])
        return np.asarray(np.einsum("kn,ne->ek", self._weights(points), entries))  # BLAS would round by its threads

    def nearest_rigid(self) -> SE2:
        """Return the rigid transform that fits the tiles best."""
        # Centroids in one row do not determine the rotation of the map; the rotations of the tiles do.
        around = np.array([(0.0, 0.0), (self.reach_m, 0.0), (0.0, self.reach_m)])
        before = np.vstack([centroid + around for centroid in self.centroids])
        after = np.vstack(
            [m.apply(centroid + around) for centroid, m in zip(self.centroids, self.motions, strict=True)]
        )
        return fit_rigid(after, before)[0]

    def nearest_in_overlap(self, target: WallMap, source: WallMap) -> SE2:
        """Return the rigid transform that fits best over the area that both maps know.

        The tiles that fit lie unevenly in this area, so `nearest_rigid` prefers a part of it.
        """
        points, _ = source.some_known
        moved = self.apply(points)
        common = target.knows(moved)
        if np.count_nonzero(common) < _LEAST_COMMON:
            return self.nearest_rigid()
        return fit_rigid(moved[common], points[common])[0]

    def residuals(self, rigid: SE2) -> tuple[float, float]:
        """Return the RMS differences of the tiles from a rigid transform [m], [rad]."""
        distances = np.linalg.norm(rigid.apply(self.centroids) - self.apply(self.centroids), axis=1)
        rotations = [wrap_angle(motion.theta - rigid.theta) for motion in self.motions]
        return float(np.sqrt(np.mean(distances**2))), float(np.sqrt(np.mean(np.square(rotations))))

    def scale(self) -> tuple[float, float]:
        """Return the scale that fits the tiles' centroids best, and the share of the deformation that it explains.

        The share is of the squared residuals of a rigid transform. It is 0 for fewer than three tiles, since any two
        centroids fit at some scale.
        """
        if len(self.centroids) < 3:
            return 1.0, 0.0
        targets = self._target_centroids()
        middle = targets.mean(axis=0)
        motion, scale = fit_rigid(targets, self.centroids)
        rigid = motion.apply(self.centroids) - middle
        left, left_scaled = (float(((factor * rigid + middle - targets) ** 2).sum()) for factor in (1.0, scale))
        return scale, 1.0 - left_scaled / left if left > 0.0 else 0.0

    def scale_error(self) -> float | None:
        """Return the scale of a deformation that is mostly a scale, else None."""
        scale, share = self.scale()
        return scale if abs(scale - 1.0) > _MIN_SCALE_ERROR and share > _MIN_SCALE_SHARE else None

    def inverse(self) -> "Deformation":
        """Return the deformation from the target to the source."""
        return Deformation(self._target_centroids(), [motion.inverse() for motion in self.motions], self.reach_m)

    def _target_centroids(self) -> FloatArray:
        """Return the centroids (N, 2) in the target's frame, each by the transform of its tile [m]."""
        return np.array([m.apply(centroid) for centroid, m in zip(self.centroids, self.motions, strict=True)])

    def then(self, onward: "Deformation") -> "Deformation":
        """Return the composition with a deformation of the target."""
        targets = self._target_centroids()
        motions = [onward.motion_at(target) @ motion for target, motion in zip(targets, self.motions, strict=True)]
        return Deformation(self.centroids, motions, self.reach_m)

    def in_frames(self, T_target_other: SE2, T_source_new: SE2) -> "Deformation":
        """Return the deformation expressed in another frame of the target and another frame of the source."""
        T_other_target = T_target_other.inverse()
        motions = [T_other_target @ motion @ T_source_new for motion in self.motions]
        return Deformation(T_source_new.inverse().apply(self.centroids), motions, self.reach_m)

    def deformed(self, grid: TbmGrid, T_target_source: SE2) -> TbmGrid:
        """Return the deformed map in the source's frame; the rigid T_target_source then aligns it with the target."""
        T_source_target = T_target_source.inverse()
        geometry = _covering(T_source_target.apply(self.apply(_sample_points(grid.geometry))), grid)
        masses = TiledMasses(geometry.rows, geometry.cols)
        for first in range(0, geometry.rows, _BAND):
            last = min(first + _BAND, geometry.rows)
            band = geometry.part(first, last, 0, geometry.cols)
            masses.put_rows(first, _read(grid, *self._cells_of(band, T_source_target, grid.geometry)))
        return TbmGrid(geometry, masses)

    def _cells_of(self, wanted: GridGeometry, T_source_target: SE2, source: GridGeometry) -> tuple[IntArray, IntArray]:
        """Return the row and the column in the source (rows, cols each) of each wanted cell."""
        rows, cols = (np.arange(0, size + _STEP, _STEP) for size in (wanted.rows, wanted.cols))
        centres = wanted.centres_of(*(index.ravel() for index in np.meshgrid(rows, cols, indexing="ij")))
        points = centres
        for _ in range(_ROUNDS):
            missing = centres - T_source_target.apply(self.apply(points))
            points = points + missing
            if np.abs(missing).max() < _EXACT * source.resolution:
                break
        cells = (points - (source.origin_x, source.origin_y)) / source.resolution
        row, col = np.mgrid[: wanted.rows, : wanted.cols].astype(np.float32) / _STEP
        x, y = (
            np.floor(cv2.remap(coordinate, col, row, cv2.INTER_LINEAR)).astype(np.int64)
            for coordinate in cells.reshape(len(rows), len(cols), 2).astype(np.float32).transpose(2, 0, 1)
        )
        return y, x

    def _weights(self, points: FloatArray) -> FloatArray:
        """Return the weights (K, N) of the tiles at points (K, 2)."""
        dx, dy = (points[:, [axis]] - self.centroids[:, axis] for axis in range(2))
        squares = dx * dx + dy * dy
        weights = np.exp((squares.min(axis=1, keepdims=True) - squares) / (2.0 * self.reach_m**2))
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _read(grid: TbmGrid, rows: IntArray, cols: IntArray) -> Masses:
    """Return the masses (rows, cols, 4) of cells of a grid; cells outside the grid are unknown."""
    inside = (rows >= 0) & (rows < grid.geometry.rows) & (cols >= 0) & (cols < grid.geometry.cols)
    masses = vacuous_masses(*inside.shape)
    rows, cols = rows[inside], cols[inside]
    if len(rows):
        first, last = int(rows.min()), int(rows.max()) + 1
        masses[inside] = grid.masses_of_rows(first, last)[rows - first, cols]
    return masses


def _sample_points(geometry: GridGeometry) -> FloatArray:
    """Return evenly spaced points (N, 2) of a grid, including its corners [m]."""
    left, bottom, right, top = geometry.bounds()
    count = 2 + max(geometry.rows, geometry.cols) // 64
    x, y = np.meshgrid(np.linspace(left, right, count), np.linspace(bottom, top, count))
    return np.column_stack((x.ravel(), y.ravel()))


def _covering(points: FloatArray, grid: TbmGrid) -> GridGeometry:
    """Return a geometry on the lattice of a grid that contains points (N, 2) and a margin."""
    g = grid.geometry
    left, top = np.floor((points.min(axis=0) - (g.origin_x, g.origin_y)) / g.resolution).astype(int).tolist()
    right, bottom = np.ceil((points.max(axis=0) - (g.origin_x, g.origin_y)) / g.resolution).astype(int).tolist()
    return g.part(top - _STEP, bottom + _STEP, left - _STEP, right + _STEP)


_LEAST_WALL = 0.5
"""Tiles with less wall than this share of the requested side are not used: they do not fix a pose."""


def tiles_of(structure: WallMap, side_m: float, most: int) -> list[WallMap]:
    """Cut the known part of a map into tiles of one size, and leave out tiles with little wall.

    No side is longer than `side_m` [m], unless there would be more than `most` tiles.
    """
    rows, cols = (np.flatnonzero(structure.states.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return []
    (first_row, rows_known), (first_col, cols_known) = (
        (int(known[0]), int(np.ptp(known)) + 1) for known in (rows, cols)
    )
    side = side_m / structure.geometry.resolution
    while math.ceil(rows_known / side) * math.ceil(cols_known / side) > most:
        side *= 1.1
    tiles = [
        structure.cut(row, col)
        for row in pairwise(_cuts(first_row, rows_known, side))
        for col in pairwise(_cuts(first_col, cols_known, side))
    ]
    return [tile for tile in tiles if tile.wall_m >= _LEAST_WALL * side_m]


def _cuts(first: int, size: int, side: float) -> list[int]:
    """Return the bounds of equal parts of a row of cells, each at most a side long."""
    count = max(math.ceil(size / side), 1)
    return [first + round(size * index / count) for index in range(count + 1)]


@dataclass(frozen=True)
class DeformableMap:
    """A map that may be deformed."""

    grid: TbmGrid
    structure: WallMap
    config: MergeConfig
    """The parameters, with the size of the tiles."""

    @classmethod
    def of(cls, grid: TbmGrid, config: MergeConfig, structure: WallMap | None = None) -> "DeformableMap":
        """Return a deformable map of a grid; its structure is computed unless it is given."""
        return cls(grid, structure or WallMap.from_grid(grid, config.structure), config)

    @cached_property
    def rounds(self) -> Sequence[Sequence[WallMap]]:
        """The tiles of each round of registration, large ones first."""
        settings = self.config.nonrigid
        large = tiles_of(self.structure, settings.side_m, settings.most)
        small = tiles_of(self.structure, settings.side_m / 2.0, 4 * settings.most)
        return (large, small, small) if len(large) > 1 else (small, small)


@dataclass(frozen=True)
class DeformedMap:
    """A map that was deformed to fit another map."""

    deformation: Deformation
    motion: SE2
    """The rigid T_target_source nearest to it over the common area, which aligns the deformed map."""
    residual_m: float
    residual_rad: float
    """RMS differences between the tiles' transforms and `motion` [m], [rad]."""
    grid: TbmGrid
    """The deformed map in its own frame."""


@dataclass(frozen=True)
class TileFit:
    """A deformation by tiles that fit a target map."""

    deformation: Deformation
    support_m: float
    """Agreeing wall of the fitting tiles, less the weighted length of the compared walls that do not agree [m]."""


def fit_tiles(target: WallMap, source: DeformableMap, start: SE2, config: MergeConfig) -> TileFit | None:
    """Register the tiles of a source map near an initial pose, round by round; None if fewer than two small tiles fit.

    Where maps overlap little, fewer than two of the large tiles may fit; the small tiles then start at the initial
    pose.
    """
    initial = Deformation.of_rigid(start)
    fit = _registered_tiles(target, source.rounds[0], initial, config)
    for before, tiles in pairwise(source.rounds):
        if fit is None and tiles is before:
            return None  # the small tiles did not fit, and would not from here
        fit = _registered_tiles(target, tiles, fit.deformation if fit else initial, config)
    return fit


def deformed_by(deformation: Deformation, motion: SE2, source: DeformableMap) -> DeformedMap:
    """Return a source map after a deformation, with the rigid transform nearest to it."""
    residual_m, residual_rad = deformation.residuals(motion)
    return DeformedMap(deformation, motion, residual_m, residual_rad, deformation.deformed(source.grid, motion))


def _registered_tiles(
    target: WallMap, tiles: Sequence[WallMap], initial: Deformation, config: MergeConfig
) -> TileFit | None:
    """Refine each tile from its initial pose; return the deformation by those that fit; None for fewer than two."""
    settings, fitting, support_m = config.nonrigid, list[tuple[WallMap, SE2]](), 0.0
    for tile in tiles:
        start = initial.motion_at(tile.centroid)
        motion = refine_all(target, tile, [start], config)[0]
        compared_m, agreed_m = compared_and_agreed_m(target, tile, motion, config.verification)
        fits = agreed_m >= settings.min_agreement * compared_m and agreed_m >= settings.min_wall_m
        if fits and math.dist(motion.apply(tile.centroid), start.apply(tile.centroid)) <= settings.farthest_m:
            fitting.append((tile, motion))
            support_m += agreed_m
        support_m -= config.verification.other_weight * (compared_m - agreed_m)
    if len(fitting) < 2:
        return None
    return TileFit(Deformation.of_tiles(*zip(*fitting, strict=True)), support_m)
