"""The front end of vinySLAM: each scan is matched to a belief grid and written into it.

The matchers are hill climbing, and random poses around the best pose so far (Monte Carlo).
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.search.scoring import climb_hill, search_monte_carlo, weighted_impact
from tbmslam.map.rendering import ScanInserter
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracker import PosePrior, ScanMatch, ScanMatcher, moved_from

BeamWeighting = Literal["even", "viny"]
CellScore = Literal["discrepancy", "disjunctive"]
"""vinySLAM's discrepancy to a certain hit, or the consistency of the credibilist SLAM: the mass of the disjunction on
OCCUPIED (Trehard et al., "Credibilist simultaneous localization and mapping with a lidar", IROS 2014)."""


def beam_weights(scan: LaserScan, weighting: BeamWeighting) -> FloatArray:
    """Return the weight (M,) of every hit beam, adding up to one.

    ``even`` treats all alike. ``viny`` is vinySLAM's: of the angle to the sensor's axis, 3 for |cos| > 0.9, 2 for
    |cos| > 0.8, and |sin| + |cos| otherwise, times the square root of the range.
    """
    hit = scan.is_hit()
    if not hit.any():
        return np.zeros(0)
    if weighting == "even":
        weights = np.ones(int(hit.sum()))
    else:
        turning = scan.angle_increment + scan.beam_step.theta
        weights = _say_of_directions(len(hit), scan.angle_min, turning)[hit] * np.sqrt(scan.ranges[hit])
    return np.asarray(weights / weights.sum())


@lru_cache(maxsize=8)
def _say_of_directions(count: int, first: float, step: float) -> FloatArray:
    """Return the weights of directions (N,); the directions of a laser do not change."""
    angles = first + step * np.arange(count, dtype=np.float64)
    cosine, sine = np.abs(np.cos(angles)), np.abs(np.sin(angles))
    return np.asarray(np.select([cosine > 0.9, cosine > 0.8], [3.0, 2.0], sine + cosine))


class HillClimbingConfig(FrozenConfig):
    """The original's constants."""

    PUBLIC: ClassVar = ("method",)

    method: Literal["hill_climbing"] = "hill_climbing"
    position_step: float = Field(0.1, gt=0, description="first step along x and y [m]")
    heading_step: float = Field(0.1, gt=0, description="first step of the heading [rad]")
    halvings: int = Field(6, ge=1, description="rounds without improvement that end the search")
    extra_candidate: bool = Field(False, description="score one more candidate at the end, like the original")
    weighting: BeamWeighting = Field("viny", description="beams count alike, or by angle as in the original")
    score: CellScore = Field("discrepancy", description="score of a hit in a cell: see `CellScore`")


class HillClimbingMatcher:
    """Climbs to the nearest maximum of the score."""

    def __init__(self, config: HillClimbingConfig) -> None:
        self._config = config

    def match(self, scan: LaserScan, grid: EvidenceGrid, initial_guess: SE2) -> ScanMatch:
        """Return the local maximum that the guess leads to."""
        config = self._config
        x, y, theta, score, _ = climb_hill(
            grid.ratios,
            grid.lattice,
            scan.hit_points(),
            beam_weights(scan, config.weighting),
            initial_guess,
            (config.position_step, config.heading_step),
            config.halvings,
            config.extra_candidate,
            config.score == "disjunctive",
        )
        pose = SE2(x, y, theta)
        return ScanMatch(pose, score, moved_from(initial_guess, pose))


DrawNormals = Callable[[int], FloatArray]
"""Returns standard normal numbers (count, 3), for x, y and theta of as many candidates."""


class MonteCarloConfig(FrozenConfig):
    """The original's constants."""

    PUBLIC: ClassVar = ("method",)

    method: Literal["monte_carlo"] = "monte_carlo"
    position_deviation: float = Field(0.2, gt=0, description="standard deviation of a candidate's x and y [m]")
    heading_deviation: float = Field(0.1, gt=0, description="standard deviation of a candidate's heading [rad]")
    max_failures: int = Field(
        20, ge=1, description="number of rejected candidates at one deviation that ends the search"
    )
    max_candidates: int = Field(100, ge=1, description="candidates that end the search in any case")
    weighting: BeamWeighting = Field("viny", description="beams count alike, or by angle as in the original")
    score: CellScore = Field("discrepancy", description="score of a hit in a cell: see `CellScore`")


class MonteCarloMatcher:
    """Draws candidates around the best pose; an improvement after many draws halves the deviation.

    `from_seed` makes a generator with a given seed.
    """

    def __init__(self, config: MonteCarloConfig, draw_normals: DrawNormals) -> None:
        self._config = config
        self._draw_normals = draw_normals

    @classmethod
    def from_seed(cls, config: MonteCarloConfig, seed: int) -> "MonteCarloMatcher":
        """Draw from numpy's default generator."""
        generator = np.random.default_rng(seed)
        return cls(config, lambda count: generator.standard_normal((count, 3)))

    def match(self, scan: LaserScan, grid: EvidenceGrid, initial_guess: SE2) -> ScanMatch:
        """Return the best pose drawn; it is the guess itself when nothing scored better."""
        config = self._config
        cells = (grid.ratios, grid.lattice)
        points, weights = scan.hit_points(), beam_weights(scan, config.weighting)
        disjunctive = config.score == "disjunctive"
        deviation = np.array([config.position_deviation, config.position_deviation, config.heading_deviation])
        pose, score = initial_guess, weighted_impact(*cells, points, weights, initial_guess, disjunctive)
        failures, candidates = 0, 0
        while failures < config.max_failures and candidates < config.max_candidates:
            offsets = deviation * self._draw_normals(
                min(config.max_failures - failures, config.max_candidates - candidates)
            )
            better, score = search_monte_carlo(*cells, points, weights, pose, score, offsets, disjunctive)
            if better < 0:
                failures += len(offsets)
                candidates += len(offsets)
                continue
            failures += better
            candidates += better + 1
            pose = SE2(*(float(p + o) for p, o in zip(pose, offsets[better], strict=True)))
            if failures > config.max_failures // 3:
                deviation = deviation / 2.0
                failures = 0
        return ScanMatch(pose, score, moved_from(initial_guess, pose))


class GridTrackerConfig(FrozenConfig):
    """vinySLAM's way: match in the belief grid, write every scan into it."""

    PUBLIC: ClassVar = ("kind",)

    kind: Literal["grid"] = "grid"
    matcher: Annotated[MonteCarloConfig | HillClimbingConfig, Field(discriminator="method")] = MonteCarloConfig()
    quality_if_moved: float = Field(0.9, ge=0, le=1, description="weight of a scan whose predicted pose was corrected")
    quality_if_kept: float = Field(0.6, ge=0, le=1, description="weight of a scan that kept its predicted pose")


class GridTracker:
    """Matches scans in the growing grid, with a single hypothesis, as vinySLAM does."""

    def __init__(self, config: GridTrackerConfig, grid: EvidenceGrid, inserter: ScanInserter, seed: int) -> None:
        self._config = config
        self.grid: EvidenceGrid | None = grid
        self._cells = grid
        self._inserter = inserter
        self._matcher: ScanMatcher = (
            MonteCarloMatcher.from_seed(config.matcher, seed)
            if isinstance(config.matcher, MonteCarloConfig)
            else HillClimbingMatcher(config.matcher)
        )

    def match(self, scan: LaserScan, prior: PosePrior, T_robot_sensor: SE2) -> ScanMatch:
        """Search the grid around the start; the original's steps are fixed, whatever the prior's deviations."""
        return self._matcher.match(scan, self._cells, prior.start @ T_robot_sensor)

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        """Write the scan into the grid."""
        quality = self._config.quality_if_moved if match.moved else self._config.quality_if_kept
        self._inserter.insert(scan, match.T_map_sensor, self._cells, quality)

    def is_novel(self, match: ScanMatch) -> bool:  # noqa: ARG002
        """Learn from every scan, as the original does."""
        return True
