"""Distortions of maps: deformation, ragged walls, missing parts and clutter."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import NormalDist

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from tbmslam.geometry.se2 import SE2, FloatArray

Occupancy = npt.NDArray[np.int8]

Marks = npt.NDArray[np.uint8]
"""States of cells: 0 unknown, 1 free, 2 wall."""

_FREE, _WALL = 1, 2
_SMALL_M = 1.5  # largest length of a movable object [m]
_FARTHEST_M = 0.5  # distance from the known cells beyond which other cells are left out [m]
_MARGIN = 12  # margin of unknown cells around a distorted map
_STEPS = 8  # iterations that invert the displacement of a point; each leaves a tenth of the error
_MOST_RMS = 4.0  # largest displacement in units of its root mean square


Field = Callable[[FloatArray], FloatArray]
"""Displacements (N, 2) [m] of points (N, 2) [m]."""


@dataclass(frozen=True)
class DistortedMap:
    """A distorted map of a part of a building."""

    occupancy: Occupancy
    """Occupancy (rows, cols) in percent, -1 unknown."""
    T_map_building: SE2
    """Pose of the building's frame before the deformation."""
    displacements: Field
    """Displacements that are added to points of the map to find their places in the building."""

    def laid(self, points: FloatArray) -> FloatArray:
        """Return points (N, 2) of the building in the map [m]."""
        read = points
        for _ in range(_STEPS):
            read = points - self.displacements(read)
        return self.T_map_building.apply(read)


@dataclass(frozen=True)
class Distortion:
    """The strengths of all distortions."""

    turn: float
    """Rotation of the map's frame relative to the building's [rad]."""
    deformation_m: float
    """Root mean square of the smooth displacement [m]."""
    wavelength_m: float
    """Distance over which the displacement changes [m]."""
    raggedness: float
    """Share of wall cells with a change of the thickness, 0 to 1."""
    missing: float
    """Share of the walls that becomes unknown."""
    moved: float
    """Share of the small objects that is moved."""
    clutter: float
    blobs: float
    """New objects, and unknown areas, for 100 m2."""
    speckle: float
    """Share of the free cells that becomes occupied."""

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Distortion":
        """Return a usual distortion: a deformation of 2 to 6 cm, and a little of all others."""
        return cls(
            turn=float(rng.uniform(-math.pi, math.pi)),
            deformation_m=float(rng.uniform(0.02, 0.06)),
            wavelength_m=float(rng.uniform(4.0, 15.0)),
            raggedness=float(rng.uniform(0.1, 0.6)),
            missing=float(rng.uniform(0.02, 0.12)),
            moved=float(rng.uniform(0.2, 0.7)),
            clutter=float(rng.uniform(1.0, 8.0)),
            blobs=float(rng.uniform(0.5, 4.0)),
            speckle=float(rng.uniform(0.0005, 0.004)),
        )

    @classmethod
    def of_another_time(cls, rng: np.random.Generator, deformation_m: float) -> "Distortion":
        """Return the distortion of maps of different times or programs: deformed over rooms, all objects moved."""
        usual = cls.draw(rng)
        return replace(usual, deformation_m=deformation_m, wavelength_m=float(rng.uniform(20.0, 50.0)), moved=1.0)

    def distort(self, part: Occupancy, resolution: float, rng: np.random.Generator) -> DistortedMap:
        """Return a distorted map of a part of a building (rows, cols) in percent, -1 unknown."""
        marks = np.where(part < 0, 0, np.where(part > 50, _WALL, _FREE)).astype(np.uint8)
        marks = self._refurnished(marks, resolution, rng)
        marks = self._degraded(marks, resolution, rng)
        marks, T_map_building, displacements = self._deformed(marks, resolution, rng)
        marks[(marks == _FREE) & (rng.random(marks.shape) < self.speckle)] = _WALL
        occupancy = np.full(marks.shape, -1, dtype=np.int8)
        sure_free, sure_wall = rng.integers(0, 7, marks.shape) * 5, 70 + rng.integers(0, 7, marks.shape) * 5
        occupancy[marks == _FREE] = sure_free[marks == _FREE]
        occupancy[marks == _WALL] = sure_wall[marks == _WALL]
        return DistortedMap(occupancy, T_map_building, displacements)

    def _refurnished(self, marks: Marks, resolution: float, rng: np.random.Generator) -> Marks:
        """Remove small objects and add others."""
        marks = marks.copy()
        labels, _ = ndimage.label(marks == _WALL, np.ones((3, 3)))
        for index, window in enumerate(ndimage.find_objects(labels), start=1):
            size = max(edge.stop - edge.start for edge in window)
            if size * resolution < _SMALL_M and rng.random() < self.moved:
                marks[window][labels[window] == index] = _FREE
        rows, cols = np.nonzero(marks == _FREE)
        for _ in range(rng.poisson(self.clutter * len(rows) * resolution**2 / 100.0)):
            at = int(rng.integers(len(rows)))
            half = rng.uniform(0.15, 0.4, 2) / resolution
            window, u, v = _around(marks.shape, (rows[at], cols[at]), half, float(rng.uniform(0.0, math.pi)))
            inside = marks[window]
            box = (np.abs(u) <= half[0]) & (np.abs(v) <= half[1]) & (inside > 0)
            inside[box] = _WALL
            if rng.random() < 0.6:  # most objects are solid; a table is a frame of legs and edges
                inside[box & ndimage.binary_erosion(box)] = _FREE
        return marks

    def _degraded(self, marks: Marks, resolution: float, rng: np.random.Generator) -> Marks:
        """Make walls ragged, remove parts of them, and make areas unknown."""
        wall, known = marks == _WALL, marks > 0
        roughness = _smooth_noise(marks.shape, 1.5, rng)
        grown = ndimage.binary_dilation(wall) & (roughness > _normal_quantile(1.0 - 0.5 * self.raggedness))
        gone = wall & (_smooth_noise(marks.shape, 0.6 / resolution, rng) > _normal_quantile(1.0 - self.missing))
        marks = np.where(grown, _WALL, marks).astype(np.uint8)
        behind = ndimage.binary_dilation(~known, np.ones((3, 3), np.bool_), iterations=2)
        marks[gone] = np.where(behind[gone], 0, _FREE)
        rows, cols = np.nonzero(marks)
        for _ in range(rng.poisson(self.blobs * np.count_nonzero(known) * resolution**2 / 100.0)):
            at = int(rng.integers(len(rows)))
            half = rng.uniform(0.2, 0.8, 2) / resolution
            window, u, v = _around(marks.shape, (rows[at], cols[at]), half, float(rng.uniform(0.0, math.pi)))
            marks[window][(u / half[0]) ** 2 + (v / half[1]) ** 2 <= 1.0] = 0
        return marks

    def _deformed(self, marks: Marks, resolution: float, rng: np.random.Generator) -> tuple[Marks, SE2, Field]:
        """Rotate and deform; the deformation contains no rigid motion."""
        rows, cols = np.nonzero(marks)
        points = np.asarray(np.column_stack((cols, rows)) + 0.5, dtype=np.float64) * resolution
        turn = SE2(0.0, 0.0, self.turn)
        moved = turn.apply(points)
        farthest_m = max(_FARTHEST_M, _MOST_RMS * self.deformation_m)
        margin = max(_MARGIN, math.ceil(_MOST_RMS * self.deformation_m / resolution))
        low = moved.min(axis=0) - margin * resolution
        shape = np.ceil((moved.max(axis=0) - low) / resolution).astype(int) + margin
        T_map_building = SE2(-float(low[0]), -float(low[1]), 0.0) @ turn
        y, x = np.mgrid[0 : shape[1], 0 : shape[0]]
        centres = np.asarray(np.stack((x, y), axis=-1).reshape(-1, 2) + 0.5, dtype=np.float64) * resolution
        read = T_map_building.inverse().apply(centres)
        reach = math.ceil(farthest_m / resolution)
        near = np.flatnonzero(_read(_widened(marks > 0, reach), read / resolution + reach))
        displacements = self._displacements(points, rng)
        read = read[near] + displacements(read[near])
        deformed = np.zeros(len(centres), dtype=np.uint8)
        deformed[near] = _read(marks, read / resolution)
        return deformed.reshape(shape[1], shape[0]), T_map_building, displacements

    def _displacements(self, known: FloatArray, rng: np.random.Generator) -> Field:
        """Return smooth displacements; over the known points they have the stated size and mean zero."""
        waves = 2.0 * math.pi / (self.wavelength_m * rng.uniform(0.7, 2.0, 6))
        angles, phases = rng.uniform(0.0, math.pi, 6), rng.uniform(0.0, 2.0 * math.pi, 6)
        weights = rng.normal(size=(6, 2))

        def field(at: FloatArray) -> FloatArray:
            along = at[:, :1] * (waves * np.cos(angles)) + at[:, 1:] * (waves * np.sin(angles))
            return np.asarray(np.sin(along + phases) @ weights)

        there = field(known)
        mean = there.mean(axis=0)
        size = float(np.sqrt(((there - mean) ** 2).sum(axis=1).mean()))
        return lambda points: np.asarray((field(points) - mean) * (self.deformation_m / max(size, 1e-9)))


Draw = Callable[[np.random.Generator], Distortion]
"""Draws the distortion of each map."""


def _read(image: Marks, points: FloatArray) -> Marks:
    """Return the values of an image (rows, cols) at points (N, 2) in cells; 0 outside."""
    col, row = np.floor(points).astype(np.int64).T
    inside = (row >= 0) & (row < image.shape[0]) & (col >= 0) & (col < image.shape[1])
    found = np.zeros(len(points), dtype=np.uint8)
    found[inside] = image[row[inside], col[inside]]
    return found


def _widened(known: npt.NDArray[np.bool_], cells: int) -> Marks:
    """Return which cells are within some cells of the known ones, in an image with a margin of as many cells."""
    kernel = np.ones((2 * cells + 1, 2 * cells + 1), dtype=np.uint8)
    return cv2.dilate(np.pad(known.astype(np.uint8), cells), kernel).astype(np.uint8)


def _normal_quantile(share: float) -> float:
    return NormalDist().inv_cdf(min(max(share, 1e-6), 1.0 - 1e-6))


def _smooth_noise(shape: tuple[int, ...], sigma: float, rng: np.random.Generator) -> FloatArray:
    """Return normal noise (rows, cols) of standard deviation 1 that changes over `sigma` cells."""
    noise = ndimage.gaussian_filter(rng.normal(size=shape), sigma)
    return np.asarray(noise / max(float(noise.std()), 1e-9))


def _around(
    shape: tuple[int, ...], centre: tuple[int, int], half: FloatArray, angle: float
) -> tuple[tuple[slice, slice], FloatArray, FloatArray]:
    """Return the window of a rotated object, and the offsets of its cells along and across the object [cells]."""
    reach = math.ceil(float(np.hypot(*half))) + 1
    row, col = int(centre[0]), int(centre[1])
    window = (
        slice(max(row - reach, 0), min(row + reach + 1, shape[0])),
        slice(max(col - reach, 0), min(col + reach + 1, shape[1])),
    )
    dy, dx = np.mgrid[window].astype(np.float64)
    dy, dx = dy - row, dx - col
    along, across = dx * math.cos(angle) + dy * math.sin(angle), dy * math.cos(angle) - dx * math.sin(angle)
    return window, np.asarray(along), np.asarray(across)
