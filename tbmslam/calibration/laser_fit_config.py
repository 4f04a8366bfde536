"""Every number of the fit of a laser's description to the walls that it saw."""

from typing import ClassVar

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig


class LaserFitConfig(FrozenConfig):
    """Search for the angle between beams and the range offset that fit walls best."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="search for them after the adjustment")
    most_parts: int = Field(6, ge=2, description="parts of a drive that tell them each by itself, at the most")
    least_parts: int = Field(4, ge=2, description="and at the least, or else nothing is told")
    shortest: float = Field(5.0, gt=0, description="travelled length of a part at the least [m]")
    longest: float = Field(40.0, gt=0, description="and at the most, the rest of the drive not being looked at [m]")
    least_fan: float = Field(
        1.75, gt=0, description="from the first beam to the last [rad]: narrower ones fit best with all hits in a heap"
    )
    max_range: float = Field(12.0, gt=0, description="hits beyond this are not used [m]")
    hits: int = Field(180, ge=10, description="hits of a scan that are used, about")
    deviation: float = Field(0.03, gt=0, description="of a hit from its wall [m]")
    trust: float = Field(
        0.01,
        gt=0,
        le=1,
        description="share of the tracked motions' information that counts: they err as the laser does",
    )
    notable_scale: float = Field(
        0.002, gt=0, description="share by which angles must be wrong at first sight for more rounds"
    )
    notable_offset: float = Field(0.02, gt=0, description="offset of ranges that does, too [m]")
    rounds: int = Field(12, ge=1, description="rounds at the most")
