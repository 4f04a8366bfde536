"""A stretch of a drive as one piece: what other scans, of this robot or another, can be laid onto."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tbmslam.evidence_grid import EvidenceGrid
from tbmslam.kernels.correlation import correlate
from tbmslam.kernels.lattice import Lattice
from tbmslam.laser_scan import Hits, LaserScan
from tbmslam.mapping import InsertionConfig, ScanInserter
from tbmslam.se2 import SE2, FloatArray
from tbmslam.sensor_model import SensorModelConfig
from tbmslam.surfel_map import SurfelConfig, SurfelMap


class SubmapConfig(BaseModel):
    """How a submap is made and searched."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    length: float = Field(8.0, gt=0, description="travelled length; neighbours overlap by half [m]")
    resolution: float = Field(0.2, gt=0, description="side of a cell of the field that is searched [m]")
    max_range: float = Field(40.0, gt=0, description="hits beyond this are not used [m]")
    free_penalty: float = Field(0.5, ge=0, description="what a hit in free space costs, where one on a wall gains 1")
    shift_cost: float = Field(0.03, ge=0, description="share of all hits that a metre from the guess must win [1/m]")
    same_place: float = Field(0.8, gt=0, description="places further apart are different ones [m]")
    turn_step: float = Field(0.025, gt=0, description="step of the heading in a search [rad]")


@dataclass(frozen=True)
class Find:
    """Where points agree best with a submap.

    Parameters
    ----------
    pose
        The place.
    ambiguity
        Score of the best place elsewhere over the score here: 1 means that nothing tells them apart.
    rival
        Where that other place lies from here (2,) [m].
    at_border
        Whether the place lies on the border of what was searched: a better one may lie beyond.
    """

    pose: SE2
    ambiguity: float
    rival: FloatArray
    at_border: bool


@dataclass(frozen=True)
class Fit:
    """How well points fit a submap after being laid onto its surfaces.

    Parameters
    ----------
    pose
        Where their frame lies.
    hessian
        Curvature (3, 3) there in x, y [1/m^2] and theta.
    matched
        Share of the points on surfaces.
    violated
        Share of the points in space that the submap knows to be free.
    """

    pose: SE2
    hessian: FloatArray
    matched: float
    violated: float


class Submap:
    """Surfaces and free space seen by consecutive keyframes, in the frame of one of them.

    Attributes
    ----------
    anchor
        Index of the keyframe whose laser is the frame.
    first, last
        Indices of the first and the last keyframe in it.
    """

    _TOLERANCES = np.array([20.0, 8.0, 3.0])

    def __init__(
        self,
        first: int,
        last: int,
        poses: FloatArray,
        scans: Sequence[LaserScan],
        config: SubmapConfig,
        surfels: SurfelConfig,
    ) -> None:
        self.first, self.last, self.anchor = first, last, (first + last) // 2
        self._config = config
        self._surfaces = SurfelMap(surfels)
        grid = EvidenceGrid(config.resolution)
        inserter = ScanInserter(_SENSOR, InsertionConfig(max_range=config.max_range, once_per_scan=True))
        T_anchor_map = SE2.from_array(poses[self.anchor]).inverse()
        for index in range(first, last + 1):
            T_anchor_sensor = T_anchor_map @ SE2.from_array(poses[index])
            hits = scans[index].hits(config.max_range).placed(T_anchor_sensor)
            self._surfaces.insert(hits.points, hits.normals, renew=False)
            inserter.insert(scans[index], T_anchor_sensor, grid)
        self._surfaces.freeze()
        self._lattice: Lattice = grid.lattice
        self._field = _search_field(grid, config.free_penalty)

    def search(self, points: FloatArray, guess: SE2, shift: float, turn: float) -> Find:
        """Find where points (N, 2) agree best with the submap, within `shift` [m] and `turn` [rad] of a guess.

        Hits on walls speak for a pose, hits in free space against it, and what is unknown says nothing. Of places that
        agree alike the nearest one is taken.
        """
        config = self._config
        reach = math.ceil(shift / config.resolution)
        count = math.ceil(turn / config.turn_step)
        turns = np.arange(-count, count + 1, dtype=np.float64) * config.turn_step
        sums = correlate(self._field, self._lattice, points, guess, turns, reach)
        offsets = np.arange(-reach, reach + 1) * config.resolution
        sums -= (config.shift_cost * len(points) * np.hypot(offsets[:, None], offsets)).astype(np.float32)
        k, row, col = (int(index) for index in np.unravel_index(int(np.argmax(sums)), sums.shape))
        best = float(sums[k, row, col])
        pose = SE2(
            guess.x + (col - reach) * config.resolution,
            guess.y + (row - reach) * config.resolution,
            guess.theta + float(turns[k]),
        )
        here = math.ceil(config.same_place / config.resolution)
        sums[:, max(row - here, 0) : row + here + 1, max(col - here, 0) : col + here + 1] = -np.inf
        _, other_row, other_col = (int(index) for index in np.unravel_index(int(np.argmax(sums)), sums.shape))
        elsewhere = max(float(sums.max()), 0.0)
        rival = np.array([other_col - col, other_row - row], dtype=np.float64) * config.resolution
        at_border = reach > 2 and max(abs(row - reach), abs(col - reach)) == reach
        return Find(pose, elsewhere / best if best > 0.0 else 1.0, rival, at_border)

    def fit(self, hits: Hits, guess: SE2) -> Fit:
        """Lay hits onto the surfaces near a guess, and tell how well they fit there."""
        points = hits.points
        weights = np.full(len(points), 40.0 / len(points))
        prior = np.diag([4.0, 4.0, 25.0])
        laid = self._surfaces.register(points, hits.normals, weights, guess, prior, self._TOLERANCES, 10)
        resolution, first_row, first_col = self._lattice
        col, row = np.floor(laid.pose.apply(points) / resolution).astype(np.int64).T - [[first_col], [first_row]]
        rows, cols = self._field.shape
        inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
        violated = float((self._field[row[inside], col[inside]] < 0.0).sum()) / len(points)
        return Fit(laid.pose, laid.hessian, laid.matched, violated)


_SENSOR = SensorModelConfig(hit_probability=0.95, hit_quality=0.5, miss_probability=0.02, miss_quality=0.3, wall_blur=0)


def _search_field(grid: EvidenceGrid, free_penalty: float) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """Return 1 on walls and next to them, `-free_penalty` where it is free, 0 where nothing is known."""
    free_ratio, occupied_ratio = grid.ratios[..., 0], grid.ratios[..., 1]
    wall = np.pad(occupied_ratio > 1.5, 1)
    near = wall.copy()
    near[1:] |= wall[:-1]
    near[:-1] |= wall[1:]
    near[:, 1:] |= near[:, :-1].copy()
    near[:, :-1] |= near[:, 1:].copy()
    field = np.where(near[1:-1, 1:-1], 1.0, np.where(free_ratio > 1.5, -free_penalty, 0.0))
    return field.astype(np.float32)


def split_into_submaps(poses: FloatArray, length: float) -> list[tuple[int, int]]:
    """Return (first, last) keyframe of stretches of a drive, each `length` metres long and overlapping by half."""
    travelled = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
    count = max(math.ceil(2.0 * travelled[-1] / length) - 1, 1)
    stretches = []
    for number in range(count):
        begin = 0.5 * length * number
        first = int(np.searchsorted(travelled, begin, side="left"))
        last = int(np.searchsorted(travelled, begin + length, side="right")) - 1
        stretches.append((first, max(last, first)))
    return stretches
