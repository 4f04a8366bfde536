"""Whether the odometry is faulty now: reversed, frozen or slipping faults last for a while.

A hidden Markov model of two states, right and faulty, with one step for each keyframe. Right odometry errs by Student's
t distribution. Faulty odometry says nothing, so its error costs the same wherever the robot is. The forward algorithm
gives the probability of a fault (L. Rabiner, "A tutorial on hidden Markov models", 1989). So the first keyframe of a
fault needs much evidence of the scans, and the next ones need little.
"""

import math

from tbmslam.tracking.odometry_noise import FREEDOM

_BEGINS = 1e-3
"""Probability that a fault begins at a keyframe."""
_LASTS = 0.9
"""Probability that a fault lasts until the next keyframe, so ten keyframes or some three metres in the mean."""
_FAULTY_COST = 4.0
"""Negative log-likelihood of any pose under faulty odometry; it is 0 at the mean of right odometry. With 6, intel-real
errs by 0.85 m in one of seven runs with reversed odometry; 3 is as good as 4."""
_SUSPECTED = 0.01
"""Probability from which on scans decide between odometry and the last motion: ten times that of a new fault."""


def right_cost(surprise: float) -> float:
    """Return the negative log-likelihood of a squared Mahalanobis distance under right odometry, up to a constant."""
    return 0.5 * (FREEDOM + 3.0) * math.log1p(surprise / FREEDOM)


class OdometryFault:
    """Estimates the probability of a fault from keyframe to keyframe.

    Attributes
    ----------
    probability
        That the odometry is faulty at the next keyframe, before its scan is seen.
    """

    def __init__(self) -> None:
        self.probability = _BEGINS

    @property
    def is_suspected(self) -> bool:
        """Whether the odometry was faulty a short time ago."""
        return self.probability > _SUSPECTED

    def cost(self, surprise: float, swerves: bool) -> float:
        """Return the negative log-likelihood of a pose, up to a constant.

        Parameters
        ----------
        surprise
            Its squared Mahalanobis distance from the odometry.
        swerves
            Whether the odometry suddenly leaves the robot's last motion. A new fault does so, as robots have inertia.
            People who go along with a robot do not.
        """
        return -math.log(sum(self._likelihoods(surprise))) if swerves or self.is_suspected else right_cost(surprise)

    def observe(self, surprise: float) -> None:
        """Update the probability with a keyframe's squared Mahalanobis distance from the odometry."""
        right, faulty = self._likelihoods(surprise)
        share = faulty / (right + faulty)
        self.probability = _LASTS * share + _BEGINS * (1.0 - share)

    def _likelihoods(self, surprise: float) -> tuple[float, float]:
        """Return the likelihoods of both states with their probabilities: right, faulty."""
        right = (1.0 - self.probability) * math.exp(-right_cost(surprise))
        return right, self.probability * math.exp(-_FAULTY_COST)
