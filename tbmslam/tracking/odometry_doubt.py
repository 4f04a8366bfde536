"""How much worse the odometry is than it is thought to be, learned from where the scans say the robot is.

Wheels slip and stamps are late, on some robots far more than on others. How far scans moved the robot away from its
guess tells the variance of that guess, counting as much as the scan determined of the pose: along a featureless wall
nothing was moved and nothing is learned. (D. MacKay, "Bayesian interpolation", 1992: a prior's variance is the sum of
squares over the number of well-determined parameters.)
"""

import math

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.kernels.determined import determined_shares
from tbmslam.se2 import SE2, FloatArray


class OdometryDoubtConfig(FrozenConfig):
    """How the odometry's real errors are learned."""

    enabled: bool = Field(True, description="doubt the odometry more where scans find it worse than stated")
    memory: float = Field(30.0, gt=0, description="number of keyframes that are looked back at")
    certainty: float = Field(10.0, gt=0, description="keyframes that the stated errors count for")
    largest: float = Field(10.0, ge=1, description="how many times the stated deviations the errors may be")


class OdometryDoubt:
    """Learns by which factors the odometry's deviations are larger than stated, for position and heading.

    Attributes
    ----------
    of_position, of_heading
        The factors, at least 1.
    """

    def __init__(self, config: OdometryDoubtConfig) -> None:
        self._config = config
        self._kept = math.exp(-1.0 / config.memory)
        self._most = config.largest**2
        # Of position and of heading: sums of squares in stated variances, and of what was determined.
        self._squares, self._determined = [0.0, 0.0], [0.0, 0.0]
        self.of_position = self.of_heading = 1.0

    def note(self, guess: SE2, pose: SE2, deviations: FloatArray, information: FloatArray) -> None:
        """Learn from where a scan was found.

        Parameters
        ----------
        guess
            The laser's pose by odometry.
        pose
            Where it was found.
        deviations
            Standard deviations (3,) of the guess, factors included.
        information
            What the scan tells of x, y [1/m^2] and theta [1/rad^2] (3, 3).
        """
        if not self._config.enabled:
            return
        x, y, theta = determined_shares(information, deviations)
        position, heading = float(deviations[0]) / self.of_position, float(deviations[2]) / self.of_heading
        shift = ((pose.x - guess.x) ** 2 + (pose.y - guess.y) ** 2) / position**2
        turn = (math.remainder(pose.theta - guess.theta, math.tau) / heading) ** 2
        self.of_position, self.of_heading = self._learned(0, shift, x + y), self._learned(1, turn, theta)

    def _learned(self, which: int, square: float, determined: float) -> float:
        """Return a factor after one more correction; a wild one counts as the largest that is thought possible."""
        self._squares[which] = self._kept * self._squares[which] + min(square, self._most)
        self._determined[which] = self._kept * self._determined[which] + determined
        certainty = self._config.certainty
        variance = (self._squares[which] + certainty) / (self._determined[which] + certainty)
        return math.sqrt(min(max(variance, 1.0), self._most))
