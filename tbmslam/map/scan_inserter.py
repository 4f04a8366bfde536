"""Writes scans into a grid of evidence."""

from typing import ClassVar, Literal

from pydantic import Field

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.rays.insertion import BeamFactors, beams_of_scan, insert_beams, insert_scan
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors


class InsertionConfig(FrozenConfig):
    """Which beams enter the map."""

    PUBLIC: ClassVar = ("max_range", "no_return")

    max_range: float = Field(
        float("inf"), gt=0, description="a hit beyond this range marks free space up to the range, and no obstacle [m]"
    )
    no_return: Literal["free", "ignore"] = Field(
        "ignore", description="a beam without a return marks free space up to its range limit, or nothing"
    )
    once_per_scan: bool = Field(
        False,
        description="each scan counts once per cell, and a hit overrides passages; else every beam counts",
    )


class ScanInserter:
    """Inserts scans taken at known poses.

    Parameters
    ----------
    sensor_model
        The evidence of a beam for a cell.
    config
        Which beams are used.
    """

    def __init__(self, sensor_model: SensorModelConfig, config: InsertionConfig) -> None:
        self._sensor_model = sensor_model
        self._config = config
        self._factors: dict[tuple[float, float], BeamFactors] = {}

    def insert(self, scan: LaserScan, T_map_sensor: SE2, grid: EvidenceGrid, scan_quality: float = 1.0) -> None:
        """Insert a scan taken with the laser at `T_map_sensor`; the grid grows as needed.

        Parameters
        ----------
        scan
            The scan.
        T_map_sensor
            Pose of the laser in the grid's frame.
        grid
            The grid to write into.
        scan_quality
            Weight in [0, 1] of the evidence of every beam, by the certainty of the pose.
        """
        limit, no_return = self._config.max_range, self._config.no_return
        starts, ends, is_hit, corners = beams_of_scan(
            scan.ranges,
            (scan.angle_min, scan.angle_increment),
            scan.beam_step,
            T_map_sensor,
            (limit, min(limit, scan.range_max)),
            no_return == "free",
        )
        if not len(ends):
            return
        grid.grow_to_contain(corners)
        insert = insert_scan if self._config.once_per_scan else insert_beams
        insert(
            grid.ratios,
            grid.lattice,
            starts,
            ends,
            is_hit,
            self._factors_for(grid.resolution, scan_quality),
        )

    def _factors_for(self, resolution: float, scan_quality: float) -> BeamFactors:
        key = (resolution, scan_quality)
        if key not in self._factors:
            self._factors[key] = beam_factors(self._sensor_model, resolution, scan_quality)
        return self._factors[key]
