"""A Rao-Blackwellised particle filter: many hypotheses of the drive, each with its own map.

The maps share square tiles. A map copies a shared tile before it writes to it.
"""

from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from tbmslam.belief.evidence_grid import EvidenceGrid, GridTooLargeError
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.grids.tiles import TILE, HitModel, TileGrid, climb_posterior, sampled_posterior, write_cells
from tbmslam.kernels.rays.insertion import BeamFactors, touched_cells
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracker import PosePrior, ScanMatch

_FIRST_TILES = 64


class TileMaps:
    """One evidence grid of shared tiles for each particle.

    All tiles together have at most `max_cells` cells; a cell takes 8 bytes.
    """

    def __init__(self, count: int, resolution: float, max_cells: int = 200_000_000) -> None:
        self.resolution = resolution
        self._max_cells = max_cells
        self._first_row, self._first_col = 0, 0
        self._places = np.zeros((count, 0, 0), dtype=np.int32)
        self._tiles = np.ones((1, TILE, TILE, 2), dtype=np.float32)  # tile 0 is the vacuous one
        self._references = np.zeros(1, dtype=np.int64)
        self._free = np.zeros(0, dtype=np.int32)
        self._free_count = 0

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self._places)

    def grid(self, number: int) -> TileGrid:
        """Return a map in the form that kernels read; it is valid until the next change."""
        return TileGrid(self._tiles, self._places[number], self.resolution, self._first_row, self._first_col)

    def insert(
        self, number: int, cells: npt.NDArray[np.int32], is_hit: npt.NDArray[np.bool_], factors: BeamFactors
    ) -> None:
        """Add evidence to a map by its number: for lattice cells (M, 2), each once, and whether each was hit (M,).

        Raises a `GridTooLargeError` if the maps together would exceed `max_cells`.
        """
        if len(cells) == 0:
            return
        rows, cols = cells.T
        low = np.array([rows.min(), cols.min()]) // TILE
        high = np.array([rows.max(), cols.max()]) // TILE
        self._grow_places(low, high)
        self._provide(int(np.prod(high - low + 1)))
        self._free_count = write_cells(
            self.grid(number), self._references, self._free, self._free_count, cells, is_hit, factors
        )

    def resample(self, ancestors: npt.NDArray[np.int64]) -> None:
        """Replace every map by the map of its ancestor (N,); unused tiles become free."""
        self._places = self._places[ancestors]
        self._references = np.bincount(self._places.ravel(), minlength=len(self._tiles))
        self._free = (np.flatnonzero(self._references[1:] == 0)[::-1] + 1).astype(np.int32)
        self._free_count = len(self._free)

    def _grow_places(self, low: npt.NDArray[np.int32], high: npt.NDArray[np.int32]) -> None:
        """Let the maps reach from tile (row, col) `low` to `high`."""
        count, rows, cols = self._places.shape
        if rows == 0:
            self._first_row, self._first_col = int(low[0]), int(low[1])
        first_row, first_col = min(self._first_row, int(low[0])), min(self._first_col, int(low[1]))
        stop_row, stop_col = (
            max(self._first_row + rows, int(high[0]) + 1),
            max(self._first_col + cols, int(high[1]) + 1),
        )
        if (stop_row - first_row, stop_col - first_col) == (rows, cols):
            return
        grown = np.zeros((count, stop_row - first_row, stop_col - first_col), dtype=np.int32)
        top, left = self._first_row - first_row, self._first_col - first_col
        grown[:, top : top + rows, left : left + cols] = self._places
        self._places, self._first_row, self._first_col = grown, first_row, first_col
        self._references[0] = np.count_nonzero(grown == 0)

    def _provide(self, needed: int) -> None:
        """Enlarge the pool until `needed` tiles are free."""
        if self._free_count >= needed:
            return
        before = len(self._tiles)
        extra = max(needed - self._free_count, before // 2, _FIRST_TILES)
        if (before + extra) * TILE**2 > self._max_cells:
            raise GridTooLargeError(
                f"the maps of {len(self)} particles would take {before + extra} tiles of {TILE} x {TILE} cells, more "
                f"than the limit of {self._max_cells} cells: use fewer tracker.particles, a coarser map.resolution or "
                "a shorter tracker.max_range, or raise map.max_cells"
            )
        self._tiles = np.concatenate((self._tiles, np.empty((extra, TILE, TILE, 2), dtype=np.float32)))
        self._references = np.concatenate((self._references, np.zeros(extra, dtype=np.int64)))
        fresh = np.arange(before + extra - 1, before - 1, -1, dtype=np.int32)
        self._free = np.concatenate((fresh, self._free[: self._free_count]))
        self._free_count += extra


class Ancestry:
    """The particles' weights and the family tree of their poses."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._log_weights = np.zeros(count)
        self._poses: list[FloatArray] = []
        self._parents: list[npt.NDArray[np.int64]] = []
        self._ancestors = np.arange(count)

    def weights(self) -> FloatArray:
        """Return the weights (N,), which add up to one."""
        relative = np.exp(self._log_weights - self._log_weights.max())
        return np.asarray(relative / relative.sum())

    def effective_number(self) -> float:
        """Return the effective number of particles, N_eff = 1 / sum of squared weights (Liu 1996)."""
        return float(1.0 / np.sum(self.weights() ** 2))

    def best(self) -> int:
        """Return the particle of the largest weight."""
        return int(np.argmax(self._log_weights))

    def weigh(self, log_likelihoods: FloatArray) -> None:
        """Multiply likelihoods, given as logarithms (N,), into the weights."""
        self._log_weights = self._log_weights + log_likelihoods
        self._log_weights -= self._log_weights.max()

    def resample(self, draw: float) -> npt.NDArray[np.int64]:
        """Draw descendants of particles in proportion to the weights, and return the parent (N,) of each.

        Systematic resampling: one draw in [0, 1) places a comb of N teeth over the cumulated weights.
        """
        teeth = (np.arange(self._count) + draw) / self._count
        chosen = np.searchsorted(np.cumsum(self.weights()), teeth, side="right").clip(max=self._count - 1)
        self._log_weights = np.zeros(self._count)
        self._ancestors = self._ancestors[chosen]
        return chosen

    def record(self, poses: FloatArray) -> None:
        """Append the poses (N, 3) of the particles as they are now."""
        self._poses.append(poses.copy())
        self._parents.append(self._ancestors)
        self._ancestors = np.arange(self._count)

    def path(self) -> FloatArray:
        """Return the recorded poses (K, 3) of the best particle and its ancestors."""
        path = np.empty((len(self._poses), 3))
        particle = int(self._ancestors[self.best()]) if len(path) else 0
        for step in range(len(path) - 1, -1, -1):
            path[step] = self._poses[step][particle]
            particle = int(self._parents[step][particle])
        return path


class ParticleTrackerConfig(FrozenConfig):
    """A Rao-Blackwellised particle filter: many hypotheses about the drive, each with a map of its own."""

    PUBLIC: ClassVar = ("kind", "particles")

    kind: Literal["particles"] = "particles"
    particles: int = Field(30, ge=1, description="hypotheses")
    resample_below: float = Field(
        0.5, ge=0, le=1, description="N_eff, as a share of the particles, below which to resample"
    )
    max_points: int = Field(120, ge=10, description="hits of a scan that are matched, evenly spaced")
    max_range: float = Field(30.0, gt=0, description="hits beyond this range are neither matched nor inserted [m]")
    independent_points: float = Field(
        40.0, gt=0, description="number of independent hits that a scan counts for in matching"
    )
    weighing_points: float = Field(8.0, gt=0, description="the same when the particles are weighted")
    clutter: float = Field(0.05, gt=0, lt=1, description="likelihood of a hit in free space; 1 on a certain wall")
    unknown: float = Field(0.3, ge=0, le=1, description="likelihood of a hit in an unknown cell")
    spread: float = Field(0.8, gt=0, description="standard deviation of a hit from its cell's centre [cells]")
    position_step: float = Field(0.1, gt=0, description="first step of the search along x and y [m]")
    heading_step: float = Field(0.04, gt=0, description="first step of the search in heading [rad]")
    halvings: int = Field(4, ge=1, description="rounds without improvement that end a search")
    proposal_steps: tuple[float, float] = Field((0.04, 0.01), description="lattice around the best pose [m, rad]")


class ParticleTracker:
    """Places scans in the best particle's map, and lets all particles learn from keyframes.

    `maps` has an empty map for every particle, and `factors` are those of a scan for the cells that it touches. The
    seed determines the random numbers by which particles differ.
    """

    def __init__(self, config: ParticleTrackerConfig, maps: TileMaps, factors: BeamFactors, seed: int) -> None:
        if len(maps) != config.particles:
            raise ValueError(f"maps must be one for each of {config.particles} particles, got {len(maps)}")
        self._config = config
        self.grid: EvidenceGrid | None = None
        self._maps = maps
        self._factors = factors
        self._generator = np.random.default_rng(seed)
        self._ancestry = Ancestry(config.particles)
        self._poses = np.zeros((config.particles, 3))
        self._variances = np.zeros(3)
        self._last = SE2.identity()  # of the best particle, when it learnt
        self._T_now_before = SE2.identity()  # the correction of the last keyframe after it was placed

    def match(self, scan: LaserScan, prior: PosePrior, T_robot_sensor: SE2) -> ScanMatch:
        """Search the best particle's map around the start."""
        guess, deviations = self._T_now_before @ prior.start @ T_robot_sensor, np.array(prior.motion)
        self._T_now_before = SE2.identity()
        self._variances = deviations**2
        points = self._matched_points(scan)
        if len(points) == 0 or not deviations.any():
            return ScanMatch(guess, 0.0, moved=False)
        pose, value = self._climb(self._ancestry.best(), points, guess, deviations)
        return ScanMatch(pose, value, moved=pose != guess)

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        """Move, weigh and perhaps resample the particles, and write the scan into the map of each."""
        points = self._matched_points(scan)
        if not self._variances.any():
            self._poses[:] = match.T_map_sensor
        else:
            self._move(points, self._last.inverse() @ match.T_map_sensor)
            if self._ancestry.effective_number() < self._config.resample_below * len(self._poses):
                chosen = self._ancestry.resample(self._generator.random())
                self._maps.resample(chosen)
                self._poses = self._poses[chosen]
        self._write(scan)
        self._ancestry.record(self._poses)
        self._variances = np.zeros(3)
        self._last = SE2.from_array(self._poses[self._ancestry.best()])
        self._T_now_before = self._last @ match.T_map_sensor.inverse()

    def is_novel(self, match: ScanMatch) -> bool:  # noqa: ARG002
        """Learn from keyframes alone."""
        return False

    def revised_poses(self) -> FloatArray:
        """Return the poses (K, 3) of the laser at everything learnt, as the best particle remembers them now."""
        return self._ancestry.path()

    def _move(self, points: FloatArray, step: SE2) -> None:
        """Draw every particle's new pose from its own posterior, and weigh the particle by how likely the scan was."""
        config, deviations = self._config, np.sqrt(self._variances)
        normals = self._generator.standard_normal(self._poses.shape)
        evidence = np.zeros(len(self._poses))
        for number, pose in enumerate(self._poses):
            guess = SE2.from_array(pose) @ step
            mode, _ = self._climb(number, points, guess, deviations)
            mean, covariance, evidence[number] = sampled_posterior(
                self._maps.grid(number),
                points,
                mode,
                guess,
                (float(deviations[0]), float(deviations[2])),
                self._model(len(points)),
                config.proposal_steps,
            )
            root = np.linalg.cholesky(covariance + np.diag([1e-8, 1e-8, 1e-10]))
            self._poses[number] = mean + root @ normals[number]
        self._ancestry.weigh(evidence * (config.weighing_points / config.independent_points))

    def _climb(self, number: int, points: FloatArray, guess: SE2, deviations: FloatArray) -> tuple[SE2, float]:
        config = self._config
        x, y, theta, value = climb_posterior(
            self._maps.grid(number),
            points,
            guess,
            (float(deviations[0]), float(deviations[2])),
            self._model(len(points)),
            (config.position_step, config.heading_step),
            config.halvings,
        )
        return SE2(x, y, theta), value

    def _write(self, scan: LaserScan) -> None:
        hits = scan.hit_points(self._config.max_range)
        is_hit = np.ones(len(hits), dtype=np.bool_)
        for number, pose in enumerate(self._poses):
            if len(hits):
                ends = SE2.from_array(pose).apply(hits)
                self._maps.insert(
                    number, *touched_cells(pose[None, :2], ends, is_hit, self._maps.resolution), self._factors
                )

    def _matched_points(self, scan: LaserScan) -> FloatArray:
        return scan.hits(self._config.max_range).thinned(self._config.max_points).points

    def _model(self, count: int) -> HitModel:
        config = self._config
        return HitModel(config.independent_points / max(count, 1), config.clutter, config.unknown, config.spread)
