"""Parameters of the grid."""

from typing import ClassVar, Self

from pydantic import Field, model_validator

from tbmslam.frozen_config import FrozenConfig
from tbmslam.map.scan_inserter import InsertionConfig
from tbmslam.sensing.sensor_model import SensorModelConfig


class MapConfig(FrozenConfig):
    """The grid and what beams write into it."""

    PUBLIC: ClassVar = ("resolution", "max_cells", "keep_conflict")

    resolution: float = Field(0.05, ge=0.001, le=10.0, description="side of a cell [m]")
    max_cells: int = Field(
        60_000_000,
        ge=1000,
        description="limit on the number of cells; a larger map gets coarser cells, and a grid that grows during the "
        "drive ends; a cell takes 28 bytes while it is drawn and 16 afterwards",
    )
    # A beam that speaks a little for both contradicts itself, and many that agree would fill a cell with conflict.
    sensor_model: SensorModelConfig = SensorModelConfig(
        hit_probability=1.0, hit_quality=0.274, miss_probability=0.0, miss_quality=0.096, wall_blur=0.0
    )
    insertion: InsertionConfig = InsertionConfig(once_per_scan=True)
    keep_conflict: bool = Field(True, description="keep the conflict of hits and misses as the fourth mass")

    @model_validator(mode="after")
    def _check_once_per_scan(self) -> Self:
        if self.insertion.once_per_scan and self.sensor_model.wall_blur > 0.0:
            raise ValueError("sensor_model.wall_blur must be 0 where insertion.once_per_scan is on")
        if self.insertion.once_per_scan and self.sensor_model.combination == "mean":
            raise ValueError("sensor_model.combination must be 'conjunctive' where insertion.once_per_scan is on")
        return self
