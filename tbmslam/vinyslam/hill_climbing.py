"""vinySLAM's deterministic matcher: steps along the axes, halved when none helps."""

from typing import ClassVar, Literal

from pydantic import Field

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.search.scoring import climb_hill
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracker import ScanMatch, moved_from
from tbmslam.vinyslam.beam_weights import BeamWeighting, CellScore, beam_weights


class HillClimbingConfig(FrozenConfig):
    """The original's constants."""

    PUBLIC: ClassVar = ("method",)

    method: Literal["hill_climbing"] = "hill_climbing"
    position_step: float = Field(0.1, gt=0, description="first step along x and y [m]")
    heading_step: float = Field(0.1, gt=0, description="first step of the heading [rad]")
    halvings: int = Field(6, ge=1, description="rounds without improvement that end the search")
    extra_candidate: bool = Field(False, description="score one more candidate at the end, as the original does")
    weighting: BeamWeighting = Field("viny", description="beams count alike, or by angle as in the original")
    score: CellScore = Field("discrepancy", description="what a hit gains in a cell: see `CellScore`")


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
