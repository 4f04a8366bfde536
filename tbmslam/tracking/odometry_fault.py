"""The probability that the odometry is faulty: it may be reversed, frozen or slip for some time.

A hidden Markov model of two states, right and faulty, with one step for each keyframe. Right odometry errs by Student's
t distribution. Faulty odometry says nothing, so its error costs the same wherever the robot is. The forward algorithm
gives the probability of a fault (L. Rabiner, "A tutorial on hidden Markov models", 1989). So the first keyframe of a
fault needs much evidence of the scans, and the next ones need little.
"""

import math

from tbmslam.tracking.odometry_noise import student_cost

_BEGINS = 0.01
"""Probability that a fault begins at a keyframe. 0.001 is as good."""
_LASTS = 0.9
"""Probability that a fault lasts until the next keyframe, so ten keyframes or some three metres in the mean."""
_FAULTY_COST = 5.0
"""Negative log-likelihood of any pose under faulty odometry; it is 0 at the mean of right odometry. Of 28 runs with
reversed odometry (`benchmark.py perturb`) one exceeds its bar, with 4 five do, with 6 two."""
_SUSPECTED = 0.1
"""From this probability on other hypotheses are tried: ten times that of a new fault."""


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

    def cost(self, surprise: float) -> float:
        """Return the negative log-likelihood of a pose by its squared Mahalanobis distance from the odometry."""
        return -math.log(sum(self._likelihoods(surprise)))

    def observe(self, surprise: float) -> None:
        """Update the probability with a keyframe's squared Mahalanobis distance from the odometry."""
        right, faulty = self._likelihoods(surprise)
        share = faulty / (right + faulty)
        self.probability = _LASTS * share + _BEGINS * (1.0 - share)

    def _likelihoods(self, surprise: float) -> tuple[float, float]:
        """Return the likelihoods of both states with their probabilities: right, faulty."""
        right = (1.0 - self.probability) * math.exp(-student_cost(surprise))
        return right, self.probability * math.exp(-_FAULTY_COST)
