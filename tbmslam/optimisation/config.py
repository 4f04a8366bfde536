"""Every number of the adjustment of drives and walls to each other."""

from typing import ClassVar

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig


class AdjustmentConfig(FrozenConfig):
    """Joint optimisation of poses and wall lines."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="optimise poses and wall lines after loop closure")
    quick_rounds: int = Field(5, ge=0, description="how often a third of the hits is assigned to pieces of wall")
    rounds: int = Field(1, ge=1, description="how often all hits are, after that")
    stretch: float = Field(1.0, gt=0, description="travelled length that moves as one [m]")
    turn: float = Field(1.0, gt=0, description="turned angle that moves as one [rad]")
    max_range: float = Field(
        30.0, gt=0, description="hits beyond this, or beyond what loops are closed by, are not used [m]"
    )
    hits: int = Field(200, ge=10, description="hits of a keyframe that are used, about")
    gap: float = Field(0.5, gt=0, description="between the neighbours of a hit at the most [m]")
    bulge: float = Field(0.03, gt=0, description="of a hit from the line between its neighbours at the most [m]")
    cell: float = Field(0.3, gt=0, description="side of a cell that holds one piece of wall in a direction [m]")
    sectors: int = Field(8, ge=4, description="directions of walls that are told apart")
    min_hits: float = Field(5.0, gt=0, description="hits of a piece of wall, those of one sighting counted as below")
    enough: float = Field(10.0, gt=0, description="hits of one sighting of a piece, from which on more tell little")
    thickness: float = Field(0.08, gt=0, description="standard deviation across a piece of wall at the most [m]")
    length: float = Field(0.03, gt=0, description="standard deviation along a piece of wall at the least [m]")
    deviation: float = Field(0.05, gt=0, description="of a hit from its wall [m]")
    robust_width: float = Field(2.0, gt=0, description="deviations at which a sighting begins to lose its say")
    precision: float = Field(1e-2, gt=0, lt=1, description="share of the equations' right side left unsolved")
