"""vinySLAM's way to follow the robot: match in the belief grid, write every scan into it."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.map.scan_inserter import ScanInserter
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracker import PosePrior, ScanMatch, ScanMatcher
from tbmslam.vinyslam.matching import HillClimbingConfig, HillClimbingMatcher, MonteCarloConfig, MonteCarloMatcher


class GridTrackerConfig(FrozenConfig):
    """vinySLAM's way: match in the belief grid, write every scan into it."""

    PUBLIC: ClassVar = ("kind",)

    kind: Literal["grid"] = "grid"
    matcher: Annotated[MonteCarloConfig | HillClimbingConfig, Field(discriminator="method")] = MonteCarloConfig()
    quality_if_moved: float = Field(0.9, ge=0, le=1, description="weight of a scan whose predicted pose was corrected")
    quality_if_kept: float = Field(0.6, ge=0, le=1, description="weight of a scan that kept its predicted pose")


class GridTracker:
    """Matches scans in the growing grid itself, section by section vinySLAM's single hypothesis."""

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

    def revised_poses(self) -> FloatArray | None:
        """Return None: tracked poses are final."""
        return None

    def is_novel(self, match: ScanMatch) -> bool:  # noqa: ARG002
        """Learn from every scan, as the original does."""
        return True
