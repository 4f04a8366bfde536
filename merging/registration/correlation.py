"""Registration by correlation: proposals over all rotations and shifts, refined to distinct candidates."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from merging.config import MergeConfig
from merging.config.registration import CorrelationConfig
from merging.verification import Evidence, examine_all, support_m
from merging.walls import WallMap, without_walls
from tbmslam.geometry.se2 import SE2, FloatArray, compose, wrap_angle
from tbmslam.kernels.grids.wall_sliding import slide_walls
from tbmslam.kernels.grids.walls import FACING
from tbmslam.kernels.search.distinct_places import distinct_places
from tbmslam.kernels.search.turned_images import block_peaks, draw_turned, multiply

# The plane's points and directions are complex numbers here: a rotation is a product.
_Complex = npt.NDArray[np.complex128]
_Image = npt.NDArray[np.complex64]

_Size = tuple[int, int]

_BLOCK = 8  # side of the blocks of cells that offer one peak each
_DIRECTIONS = 720  # bins of the directions of walls in a full circle


@dataclass(frozen=True)
class _Layout:
    """Walls and free space of a map as weighted points about a centre.

    `walls` (N,) have weights `metres` (N,), smaller for movable objects, and `normals` (N,). `facing` (N,) are the same
    normals, but 0 for two-sided walls. `free` (M,) are cells of the correlation with shares `filled` (M,) of free
    space.
    """

    centre: complex
    walls: _Complex
    normals: _Complex
    facing: _Complex
    metres: FloatArray
    free: _Complex
    filled: FloatArray

    @classmethod
    def of(cls, structure: WallMap, cell_m: float, clearance_m: float) -> "_Layout":
        walls = _complex(structure.points)
        centre = complex(*(structure.points.min(axis=0) + structure.points.max(axis=0)) / 2.0)
        normals = _complex(structure.normals)
        facing: _Complex = np.asarray(np.where(structure.two_sided, 0.0, normals))
        geometry = structure.geometry
        # Free space near walls does not count, so that a small displacement of a wall is no contradiction.
        factor = max(1, round(cell_m / geometry.resolution))
        blocks = _clear_blocks(structure, clearance_m, factor)
        rows, cols = np.nonzero(blocks)
        counts = blocks[rows, cols]
        side = factor * geometry.resolution
        x, y = geometry.origin_x + (cols + 0.5) * side, geometry.origin_y + (rows + 0.5) * side
        filled = np.asarray(counts * (geometry.resolution / cell_m) ** 2, dtype=np.float64)
        metres = structure.weights * geometry.resolution
        return cls(centre, walls - centre, normals, facing, metres, x + 1j * y - centre, filled)

    @cached_property
    def facing_metres(self) -> _Complex:
        """The directions of the walls, weighted."""
        return self.facing * self.metres

    def extents(self) -> FloatArray:
        """Return twice the largest distance (2,) of any point from the centre, along y and x [m]."""
        points = np.concatenate((self.walls, self.free))
        return 2.0 * np.array([np.abs(points.imag).max(), np.abs(points.real).max()])

    def radius(self) -> float:
        """Return the distance of the farthest point from the centre [m]."""
        return float(np.abs(np.concatenate((self.walls, self.free))).max())

    def spread(self) -> float:
        """Return the distance from the centre that contains 80 % of the walls [m]."""
        return float(np.quantile(np.abs(self.walls), 0.8))


class Proposals(NamedTuple):
    """The most promising motions of one map in the frame of another."""

    motions: list[SE2]
    """T_target_source (K,) of distinct poses, the best first."""
    scores: FloatArray
    """Length (K,) of agreeing minus contradicting walls, approximately [m]."""


def propose(target: WallMap, source: WallMap, config: CorrelationConfig) -> Proposals:
    """Return the most promising motions T_target_source; a map without walls has none."""
    if len(target.points) == 0 or len(source.points) == 0:
        return Proposals([], np.zeros(0))
    cell = _cell_size(target, source, config)
    search = _Search.of(target, source, cell, config)
    steps = math.ceil(2.0 * math.pi / min(max(cell / max(search.moving.spread(), cell), 0.01), 0.05))
    turns = _likely_turns(search.fixed, search.moving, steps, config)
    peaks = []
    for theta in 2.0 * math.pi * turns / steps:
        values, rows, cols = _peaks(search.scores(float(theta)), config.peaks_per_rotation)
        shifts = ((cols - search.size[1] // 2) + 1j * (rows - search.size[0] // 2)) * cell
        peaks.append(np.column_stack((values, shifts.real, shifts.imag, np.full(len(values), theta))))
    places = np.concatenate(peaks)
    best = distinct(places[:, 1:], places[:, 0], 3.0 * cell, 5.0 * math.pi / steps, config.proposals)
    fixed, moving = search.fixed.centre, search.moving.centre
    return Proposals([_motion(fixed, moving, x + 1j * y, theta) for x, y, theta in places[best, 1:]], places[best, 0])


@dataclass(frozen=True)
class _Search:
    """Two maps on cells of one size, ready to be correlated."""

    fixed: _Layout
    moving: _Layout
    cell: float
    size: _Size
    facing: _Image
    kinds: _Image

    @classmethod
    def of(cls, target: WallMap, source: WallMap, cell: float, config: CorrelationConfig) -> "_Search":
        clearance_m = max(config.clearance_m, config.clearance_cells * cell)
        fixed, moving = (_Layout.of(structure, cell, clearance_m) for structure in (target, source))
        height, width = fixed.extents() + 2.0 * moving.radius() - min(config.min_overlap_m, 2.0 * moving.radius())
        size = scipy.fft.next_fast_len(math.ceil(height / cell)), scipy.fft.next_fast_len(math.ceil(width / cell))
        return cls(fixed, moving, cell, size, *_target_spectra(fixed, size, cell, config))

    def scores(self, theta: float) -> npt.NDArray[np.float32]:
        """Return the scores (rows, cols) of all shifts of the rotated source; zero shift is in the middle."""
        moving = self.moving
        images = np.empty((2, *self.size), dtype=np.complex64)
        turn = complex(math.cos(theta), math.sin(theta))
        draw_turned(
            moving.walls, moving.facing_metres, moving.metres, moving.free, moving.filled, turn, self.cell, images
        )
        # The real part of conj(walls + i free) * (a + i b) is walls * a + free * b: both directions in one product.
        facing, kinds = scipy.fft.fft2(images, overwrite_x=True)
        half = np.empty((self.size[0], self.size[1] // 2 + 1), dtype=np.complex64)
        multiply(facing, self.facing, kinds, self.kinds, half)
        return np.asarray(scipy.fft.irfft2(half, self.size, overwrite_x=True))


def _complex(points: FloatArray) -> _Complex:
    return np.ascontiguousarray(points).view(np.complex128)[:, 0]


_BAND = 256  # rows of cells that are counted at once, to limit the memory


def _clear_blocks(structure: WallMap, clearance_m: float, side: int) -> npt.NDArray[np.int64]:
    """Return the number of free cells far from walls in each block of `side` by `side`, fewer at the far edges."""
    states, distances = structure.states, structure.distances_m
    band = side * max(_BAND // side, 1)
    return np.concatenate(
        [
            _counted((states[first : first + band] == 1) & (distances[first : first + band] > clearance_m), side)
            for first in range(0, len(states), band)
        ]
    )


def _counted(cells: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.int64]:
    """Return the number of set cells in each block of `side` by `side`; blocks at the far edges may be smaller."""
    rows, cols = (np.arange(0, size, side) for size in cells.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(cells, rows, axis=0, dtype=np.int64), cols, axis=1))


def _cell_size(target: WallMap, source: WallMap, config: CorrelationConfig) -> float:
    """Return the cell size [m] that gives maps of any size about equally many cells."""
    extent = float(sum(np.ptp(structure.points, axis=0).max() for structure in (target, source)))
    finest = max(config.min_cell_m, 2.0 * max(target.geometry.resolution, source.geometry.resolution))
    cell = min(max(extent / config.cells_along, finest), max(config.max_cell_m, finest))
    return max(cell, extent / config.most_cells)


def _likely_turns(fixed: _Layout, moving: _Layout, steps: int, config: CorrelationConfig) -> npt.NDArray[np.int64]:
    """Return the rotations under which the directions of both maps' walls agree best, as many as the config allows.

    Buildings have few directions of walls. A rotation that aligns none of them aligns no walls.
    """
    spectra = [np.fft.rfft(_directions(layout)) for layout in (fixed, moving)]
    likeness = np.fft.irfft(spectra[0] * np.conj(spectra[1]), _DIRECTIONS)
    bins = np.rint(np.arange(steps) * (_DIRECTIONS / steps)).astype(np.int64) % _DIRECTIONS
    count = min(math.ceil(config.turns_share * steps), config.most_turns)
    return np.sort(np.argsort(-likeness[bins], kind="stable")[:count])


def _directions(layout: _Layout) -> FloatArray:
    """Return the length of walls that face along each of `_DIRECTIONS` directions, smoothed over 2 degrees.

    A two-sided wall counts half along each of its normals.
    """
    bins = np.floor(np.angle(layout.normals) * (_DIRECTIONS / (2.0 * math.pi))).astype(np.int64) % _DIRECTIONS
    metres = np.bincount(bins, layout.metres, _DIRECTIONS)
    half = 0.5 * np.bincount(bins, layout.metres * (layout.facing == 0), _DIRECTIONS)
    metres += np.roll(half, _DIRECTIONS // 2) - half
    near = np.minimum(np.arange(_DIRECTIONS), _DIRECTIONS - np.arange(_DIRECTIONS))
    kernel = np.exp(-0.5 * (near * (360.0 / _DIRECTIONS) / 2.0) ** 2)
    return np.fft.irfft(np.fft.rfft(metres) * np.fft.rfft(kernel), _DIRECTIONS)


def _target_spectra(layout: _Layout, size: _Size, cell: float, config: CorrelationConfig) -> tuple[_Image, _Image]:
    """Return the target's spectra, by which those of the source's images are multiplied; see `_Search.scores`."""
    middle = (size[1] // 2 + 1j * (size[0] // 2)) * cell  # where the score of zero shift is
    walls = _splat(layout.walls + middle, layout.metres, size, cell)
    facing = _splat(layout.walls + middle, layout.facing_metres, size, cell)
    free = np.minimum(_splat(layout.free + middle, layout.filled, size, cell).real, 1.0)
    # The factor 1.5 makes a straight blurred wall count fully on its line.
    near = np.minimum(1.5 * _blurred(walls) / cell, 1.0)
    toward = 1.5 * _blurred(facing) / cell
    toward /= np.maximum(np.abs(toward), 1.0)
    kinds = config.wall_bonus * near.real - config.penalty * free - 1j * config.penalty * walls.real
    return scipy.fft.fft2(toward), scipy.fft.fft2(kinds.astype(np.complex64))


def _splat(points: _Complex, weights: _Complex | FloatArray, size: _Size, cell: float) -> _Image:
    """Return an image of weighted points about its cell (0, 0); negative coordinates wrap around."""
    rows, cols = np.floor(points.imag / cell).astype(np.int64), np.floor(points.real / cell).astype(np.int64)
    cells = rows % size[0] * size[1] + cols % size[1]
    image = np.bincount(cells, weights.real, size[0] * size[1]).astype(np.complex64)
    if weights.imag.any():
        image.imag = np.bincount(cells, weights.imag, size[0] * size[1])
    return image.reshape(size)


def _blurred(image: _Image) -> _Image:
    parts = np.dstack((image.real, image.imag))
    return np.ascontiguousarray(cv2.GaussianBlur(parts, (0, 0), 1.0)).view(np.complex64)[..., 0]


def _peaks(scores: npt.NDArray[np.float32], count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the values, rows and columns of the best cells, at most one of every block."""
    blocks = (scores.shape[0] // _BLOCK) * (scores.shape[1] // _BLOCK)
    values = np.empty(blocks, dtype=np.float32)
    rows, cols = np.zeros(blocks, dtype=np.int64), np.zeros(blocks, dtype=np.int64)
    block_peaks(scores, _BLOCK, values, rows, cols)
    best = np.argsort(-values, kind="stable")[:count]
    return values[best].astype(np.float64), rows[best].astype(np.float64), cols[best].astype(np.float64)


def _motion(target_centre: complex, source_centre: complex, shift: complex, theta: float) -> SE2:
    """Return the motion that rotates the source about its centre and shifts that from the target's centre."""
    translation = target_centre + shift - np.exp(1j * theta) * source_centre
    return SE2(float(translation.real), float(translation.imag), wrap_angle(float(theta)))


def distinct(
    poses: FloatArray, scores: FloatArray, apart_m: float, apart_rad: float, count: int
) -> npt.NDArray[np.intp]:
    """Return the indices of at most `count` best distinct poses, best first (greedy non-maximum suppression).

    Poses (N, 3) [m, m, rad] nearer to each other than both distances are equal. Of equal scores (N,) the earlier is
    better.
    """
    ranked, kept = np.argsort(-scores, kind="stable"), np.empty(min(count, len(scores)), dtype=np.int64)
    found = distinct_places(np.ascontiguousarray(poses), ranked, apart_m, apart_rad, kept)
    return np.asarray(kept[:found], dtype=np.intp)


_ELSEWHERE_M, _ELSEWHERE_RAD = 1.0, 0.15  # alignments farther apart than this are different hypotheses

_LEAST_SCORE_M = 1.0  # length of wall that agrees anywhere by chance [m]

Candidate = tuple[SE2, Evidence]
"""A motion T_target_source and its evidence."""


def find_candidates(target: WallMap, source: WallMap, config: MergeConfig) -> list[Candidate]:
    """Return the best supported distinct candidates, the best first.

    The correlation proposes many motions on coarse cells. They are refined by a few hundred walls and scored by more;
    the best are refined again and examined by all walls.
    """
    return best_of(propose(target, source, config.correlation).motions, target, source, config)


def best_of(proposals: list[SE2], target: WallMap, source: WallMap, config: MergeConfig) -> list[Candidate]:
    """Refine proposals; return the best supported distinct candidates, the best first. Maps without walls have none."""
    if not proposals or without_walls(target, source):
        return []
    how = config.refinement
    rough = np.geomspace(how.proposal_reach_m, how.first_reach_m / 2.0, how.rough_iterations)
    slid = _slid(target, source, proposals, rough, how.few_walls)
    supports = support_m(target, source, slid, config.verification, how.some_walls)
    best = best_distinct(slid, supports, source, config.correlation.semifinalists)
    finalists = refine_all(target, source, best, config)
    supports = support_m(target, source, finalists, config.verification, how.many_walls)
    finalists = best_distinct(finalists, supports, source, config.correlation.finalists)
    return list(zip(finalists, examine_all(target, source, finalists, config.verification), strict=True))


def refine_all(target: WallMap, source: WallMap, motions: list[SE2], config: MergeConfig) -> list[SE2]:
    """Refine alignments by walls, point to line."""
    how = config.refinement
    reaches = np.geomspace(how.first_reach_m, how.last_reach_m, how.iterations)
    return _slid(target, source, motions, reaches, how.many_walls)


def _slid(target: WallMap, source: WallMap, motions: list[SE2], reaches: FloatArray, count: int) -> list[SE2]:
    """Refine alignments by point-to-line ICP of up to `count` wall cells of each map, see `slide_walls`."""
    start = np.array(motions, dtype=np.float64).reshape(-1, 3)
    chosen = target.walls, target.some(count), source.walls, source.some(count)
    return [SE2.from_array(motion) for motion in slide_walls(*chosen, start, reaches, FACING)]


def lead_of(proposals: Proposals, source: WallMap) -> float:
    """Return the score of the best proposal divided by the score of the best distinct one; 0 without proposals."""
    if not proposals.motions:
        return 0.0
    best = {motion: float(score) for motion, score in zip(*proposals, strict=True)}
    scores = [best[motion] for motion in best_distinct(proposals.motions, proposals.scores, source, 2)]
    return max(scores[0], 0.0) / max(*scores[1:], _LEAST_SCORE_M)


def best_distinct(motions: list[SE2], scores: FloatArray, source: WallMap, count: int) -> list[SE2]:
    """Return up to `count` of the best motions that place the walls of the source at distinct places."""
    centroid = np.append(source.centroid, 0.0)
    centres = compose(np.array(motions, dtype=np.float64).reshape(-1, 3), centroid)
    return [motions[index] for index in distinct(centres, scores, _ELSEWHERE_M, _ELSEWHERE_RAD, count)]


def same_place(motions: Sequence[SE2], motion: SE2, source: WallMap) -> list[SE2]:
    """Return the motions that place the walls of the source where `motion` does, by the limits of `best_distinct`."""
    x, y = source.centroid.tolist()
    centroid, found = SE2(x, y, 0.0), list[SE2]()
    place = motion @ centroid
    for other in motions:
        apart = place.to(other @ centroid)
        if math.hypot(apart.x, apart.y) < _ELSEWHERE_M and abs(apart.theta) < _ELSEWHERE_RAD:
            found.append(other)
    return found
