"""vinySLAM's default matcher: random poses around the best one so far."""

from collections.abc import Callable
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.search.scoring import search_monte_carlo, weighted_impact
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracker import ScanMatch, moved_from
from tbmslam.vinyslam.beam_weights import BeamWeighting, CellScore, beam_weights

DrawNormals = Callable[[int], FloatArray]
"""Returns standard normal numbers (count, 3), for x, y and theta of as many candidates."""


class MonteCarloConfig(FrozenConfig):
    """The original's constants."""

    PUBLIC: ClassVar = ("method",)

    method: Literal["monte_carlo"] = "monte_carlo"
    position_deviation: float = Field(0.2, gt=0, description="standard deviation of a candidate's x and y [m]")
    heading_deviation: float = Field(0.1, gt=0, description="standard deviation of a candidate's heading [rad]")
    max_failures: int = Field(20, ge=1, description="candidates in vain, at one deviation, that end the search")
    max_candidates: int = Field(100, ge=1, description="candidates that end the search in any case")
    weighting: BeamWeighting = Field("viny", description="beams count alike, or by angle as in the original")
    score: CellScore = Field("discrepancy", description="what a hit gains in a cell: see `CellScore`")


class MonteCarloMatcher:
    """Draws candidates around the best pose; an improvement that took long halves the deviation.

    Parameters
    ----------
    config
        Deviations and limits.
    draw_normals
        Where the randomness comes from; by default a generator with a seed.
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
