"""Our way to follow the robot: lay each scan onto the surfaces of earlier keyframes, below the size of a cell."""

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tbmslam.evidence_grid import EvidenceGrid
from tbmslam.laser_scan import LaserScan
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2, FloatArray
from tbmslam.surfel_map import SurfelConfig, SurfelMap


class SurfelTrackerConfig(BaseModel):
    """Our way: lay each scan onto the surfaces of earlier keyframes, below the size of a cell."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["surfels"] = "surfels"
    surfels: SurfelConfig = SurfelConfig()
    max_points: int = Field(400, ge=10, description="hits of a scan that are matched, evenly chosen")
    max_range: float = Field(40.0, gt=0, description="hits beyond this are neither matched nor learnt [m]")
    independent_points: float = Field(
        40.0, gt=0, description="how many independent hits a whole scan counts for, against the odometry"
    )
    tolerances: tuple[float, ...] = Field((8.0, 3.0), description="distances at which a hit loses its say [deviations]")
    iterations: int = Field(8, ge=1, description="Gauss-Newton steps for each tolerance, at the most")
    min_matched: float = Field(
        0.1, ge=0, le=1, description="share of hits on known surfaces below which odometry rules"
    )


class SurfelTracker:
    """Registers scans on a surfel map."""

    def __init__(self, config: SurfelTrackerConfig) -> None:
        self._config = config
        self.grid: EvidenceGrid | None = None
        self._map = SurfelMap(config.surfels)
        self._tolerances = np.array(config.tolerances)

    def match(self, scan: LaserScan, T_map_sensor: SE2, deviations: FloatArray) -> ScanMatch:
        """Lay the scan onto the surfaces; directions that they leave open keep the guess."""
        config = self._config
        points = self._near_points(scan)
        points = points[:: max(len(points) // config.max_points, 1)]
        if not len(points) or not deviations.any():
            return ScanMatch(T_map_sensor, 0.0, moved=False)
        weights = np.full(len(points), config.independent_points / len(points))
        prior = np.diag(deviations**-2.0)
        result = self._map.register(points, weights, T_map_sensor, prior, self._tolerances, config.iterations)
        if result.matched < config.min_matched:
            return ScanMatch(T_map_sensor, result.matched, moved=False)
        return ScanMatch(result.pose, result.matched, moved=True)

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        """Add the scan's hits to the surfaces."""
        self._map.insert(match.T_map_sensor.apply(self._near_points(scan)))

    def _near_points(self, scan: LaserScan) -> FloatArray:
        points = scan.hit_points()
        limit = self._config.max_range
        near: FloatArray = points[np.einsum("ij,ij->i", points, points) <= limit * limit]
        return near
