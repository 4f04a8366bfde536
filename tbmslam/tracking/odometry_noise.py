"""The noise of the odometry, estimated from the registration of scans.

The deviations of a motion grow with its length and its turn. For each axis, a factor relative to the stated deviations
is learnt from the corrections between keyframes.
"""

from typing import ClassVar

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.tracking.noise_factor import NoiseFactor
from tbmslam.tracking.student_t import FREEDOM

Deviations = tuple[float, float, float]
"""Standard deviations of a pose in its own frame: along [m], across [m] and in heading [rad]."""


class OdometryNoiseConfig(FrozenConfig):
    """Initial standard deviations of the odometry, and how they are learnt."""

    PUBLIC: ClassVar = ("position_per_metre", "heading_per_metre", "heading_per_radian")

    position_floor: float = Field(0.005, gt=0, description="position deviation of any motion [m]")
    position_per_metre: float = Field(0.05, ge=0, description="position deviation per travelled metre [m/m]")
    position_per_radian: float = Field(0.05, ge=0, description="position deviation per turned radian [m/rad]")
    heading_floor: float = Field(0.005, gt=0, description="heading deviation of any motion [rad]")
    heading_per_metre: float = Field(0.05, ge=0, description="heading deviation per travelled metre [rad/m]")
    heading_per_radian: float = Field(0.1, ge=0, description="heading deviation per turned radian [rad/rad]")
    learning: bool = Field(
        True, description="estimate the odometry's noise and lag from scans, or the noise of turning without it"
    )
    memory: float = Field(100.0, gt=0, description="number of keyframes over which the factors are learnt")
    certainty: float = Field(3.0, gt=0, description="weight of the stated deviations, as a number of keyframes")


class OdometryNoise:
    """Estimates the odometry's deviations; `factors` are the ratios to the stated ones: along, across, heading."""

    def __init__(self, config: OdometryNoiseConfig) -> None:
        self._config = config
        # Needed for every scan, so they are looked up once.
        self._position = config.position_floor, config.position_per_metre, config.position_per_radian
        self._heading = config.heading_floor, config.heading_per_metre, config.heading_per_radian
        self._factors = tuple(NoiseFactor(config.memory, config.certainty) for _ in range(3))
        self.factors: Deviations = (1.0, 1.0, 1.0)

    def deviations(self, distance: float, turn: float) -> Deviations:
        """Return the deviations of a motion of some length [m] and turn [rad]."""
        floor, per_metre, per_radian = self._position
        position = floor + per_metre * distance + per_radian * turn
        floor, per_metre, per_radian = self._heading
        along, across, turning = self.factors
        return position * along, position * across, (floor + per_metre * distance + per_radian * turn) * turning

    def learn(self, error: Deviations, deviations: Deviations, motion: Deviations, determined: Deviations) -> None:
        """Learn from a correction.

        `error` is the registered pose of the robot in the frame of its prior pose: along [m], across [m], heading
        [rad]. `deviations` are those of the prior pose, `motion` those of the motion alone, as `deviations` returned
        them, and `determined` the shares of each, in [0, 1], that the scan determined.
        """
        if not self._config.learning:
            return
        a, b, c = error[0] / deviations[0], error[1] / deviations[1], error[2] / deviations[2]
        weight = (FREEDOM + 3.0) / (FREEDOM + a * a + b * b + c * c)
        along, across, heading = self._factors
        # One by one, in half the time of a loop over five tuples.
        along.learn(weight, error[0], deviations[0], motion[0], determined[0])
        across.learn(weight, error[1], deviations[1], motion[1], determined[1])
        heading.learn(weight, error[2], deviations[2], motion[2], determined[2])
        self.factors = along.value, across.value, heading.value
