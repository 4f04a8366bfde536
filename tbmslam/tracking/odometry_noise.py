"""The noise of the odometry, estimated from the registration of scans.

The deviations of a motion grow with its length and its turn. For each axis, a factor relative to the stated deviations
is learnt from the corrections between keyframes. The square of a correction is weighted by the share that the scan
determined of this axis, so nothing is learnt along a featureless wall (D. MacKay, "Bayesian interpolation", 1992: the
variance of a prior is the sum of squares over the number of well-determined parameters). Slips are outliers of
Student's t distribution and have little weight.
"""

import math
from typing import ClassVar

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig

Deviations = tuple[float, float, float]
"""Standard deviations of a pose in its own frame: along [m], across [m] and in heading [rad]."""

FREEDOM = 4.0
"""Degrees of freedom of Student's t distribution: about one correction in twenty is a slip."""

_LEAST, _MOST = 0.05, 20.0
"""Bounds of the factors: scans themselves err by a few millimetres from keyframe to keyframe."""

_OWN = 0.1
"""Share of the variance of a correction that the motion explains, below which the correction counts less. After a gap
in the scans the keyframe's own pose explains nearly all. If it counted fully, the odometry of mit-csail would be taken
as perfect for 300 keyframes."""


def student_cost(squared: float) -> float:
    """Return the negative log-likelihood of a squared Mahalanobis distance under Student's t, 0 at the mean."""
    return 0.5 * (FREEDOM + 3.0) * math.log1p(squared / FREEDOM)


class OdometryNoiseConfig(FrozenConfig):
    """Initial standard deviations of the odometry, and how they are learnt."""

    PUBLIC: ClassVar = ("position_per_metre", "heading_per_metre", "heading_per_radian")

    position_floor: float = Field(0.005, gt=0, description="position deviation of any motion [m]")
    position_per_metre: float = Field(0.05, ge=0, description="position deviation per travelled metre [m/m]")
    position_per_radian: float = Field(0.05, ge=0, description="position deviation per turned radian [m/rad]")
    heading_floor: float = Field(0.005, gt=0, description="heading deviation of any motion [rad]")
    heading_per_metre: float = Field(0.05, ge=0, description="heading deviation per travelled metre [rad/m]")
    heading_per_radian: float = Field(0.1, ge=0, description="heading deviation per turned radian [rad/rad]")
    learning: bool = Field(True, description="learn from scans by which factor the deviations differ")
    memory: float = Field(100.0, gt=0, description="number of keyframes over which the factors are learnt")
    certainty: float = Field(3.0, gt=0, description="weight of the stated deviations, as a number of keyframes")


class OdometryNoise:
    """Estimates the odometry's deviations; `factors` are the ratios to the stated ones: along, across, heading."""

    def __init__(self, config: OdometryNoiseConfig) -> None:
        self._config = config
        # Needed for every scan, so they are looked up once.
        self._position = config.position_floor, config.position_per_metre, config.position_per_radian
        self._heading = config.heading_floor, config.heading_per_metre, config.heading_per_radian
        self._kept = math.exp(-1.0 / config.memory)
        self._squares, self._determined = [config.certainty] * 3, [config.certainty] * 3
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
        self.factors = (
            self._learnt(0, weight, error[0], deviations[0], motion[0], determined[0]),
            self._learnt(1, weight, error[1], deviations[1], motion[1], determined[1]),
            self._learnt(2, weight, error[2], deviations[2], motion[2], determined[2]),
        )

    def _learnt(self, axis: int, weight: float, error: float, deviation: float, moved: float, share: float) -> float:
        """Return the factor of an axis after a correction; the arguments are the components of those of `learn`."""
        own = moved / self.factors[axis]
        # The part of the correction that the keyframe's own pose explains says nothing about the motion.
        explained = share * (deviation * deviation - moved * moved)
        counts = min((moved / deviation) ** 2 / _OWN, 1.0) ** 2
        squares = self._kept * self._squares[axis] + counts * (weight * error * error - explained) / (own * own)
        determined = self._kept * self._determined[axis] + counts * share
        self._squares[axis], self._determined[axis] = squares, determined
        return math.sqrt(min(max(squares / max(determined, 1e-9), _LEAST**2), _MOST**2))
