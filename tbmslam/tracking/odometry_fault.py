"""The probability that the odometry is faulty: it may be reversed, frozen or slip for some time.

A hidden Markov model of two states, right and faulty, with one step for each keyframe. Right odometry errs by Student's
t distribution. Faulty odometry has no information, so all reachable poses are equally likely. The forward
algorithm gives the probability of a fault (L. Rabiner, "A tutorial on hidden Markov models", 1989). So the first
keyframe of a fault needs much evidence of the scans, and the next ones need little.

After a fault right odometry either goes on from the pose that the scans gave (wheels slipped), or it is again what it
was before the fault (a reading was wrong, or readings stood still and then jumped). Both are equally likely. Without
the second hypothesis, one wrong reading tore a drive through a real exhibition by 85 degrees. Its error was 8.3 m
instead of 0.12 m.
"""

import math

from tbmslam.geometry.se2 import SE2
from tbmslam.tracking.odometry_noise import Deviations
from tbmslam.tracking.student_t import FREEDOM, student_cost

_BEGINS = 0.001
"""Probability that a fault begins at a keyframe. With 0.01 a day's drive round a block is torn at one of its
corners. Of 56 runs with reversed odometry one exceeds its bar with either."""
RESTART_COST = -math.log(_BEGINS)
"""Cost of odometry that began anew during a pause: it is as rare as a fault that begins at a keyframe."""
_LASTS = 0.9
"""Probability that a fault lasts until the next keyframe, so ten keyframes or some three metres in the mean."""
_WITHIN = (
    4.0 / 3.0 * math.pi * math.gamma(0.5 * (FREEDOM + 3.0)) / (math.gamma(0.5 * FREEDOM) * (FREEDOM * math.pi) ** 1.5)
)
"""Volume of the unit ball times the density of Student's t at its mean, in three dimensions."""
_SUSPECTED = 0.5
"""From this probability on other hypotheses are tried, because a fault is more likely than none. With 0.1 intel takes
6 % longer; of 56 runs with reversed odometry none exceeded its bar then, and one with 0.5."""


class OdometryFault:
    """Estimates the probability that the odometry is faulty at the next keyframe, before its scan is seen."""

    def __init__(self) -> None:
        self.probability = _BEGINS
        self._T_before_now: SE2 | None = None
        self._variances = 0.0, 0.0, 0.0

    @property
    def is_suspected(self) -> bool:
        """Whether the odometry was faulty a short time ago."""
        return self.probability > _SUSPECTED

    def returned(self, T_map_robot: SE2, deviations: Deviations) -> tuple[SE2, Deviations] | None:
        """Return a pose by the odometry as if the scans had not corrected it during a fault; None without a fault.

        The arguments are the pose by odometry since the last keyframe and its deviations. Those of the returned pose
        contain the deviations during the fault.
        """
        if not self.is_suspected or self._T_before_now is None:
            return None
        along, across, turn = (math.sqrt(v + d * d) for v, d in zip(self._variances, deviations, strict=True))
        return self._T_before_now @ T_map_robot, (along, across, turn)

    def cost(self, surprise: float, faulty_cost: float, returned_cost: float = math.inf) -> float:
        """Return the negative log-likelihood of a pose with a squared Mahalanobis distance from the odometry.

        `faulty_cost` is that of any pose under faulty odometry; see the function of this name. `returned_cost` is that
        of the pose if the odometry is again as before the fault. The cost of the mean of right odometry is subtracted.
        """
        return -math.log(sum(self._likelihoods(surprise, faulty_cost, returned_cost)))

    def observe(self, surprise: float, faulty_cost: float, returned_cost: float = math.inf) -> None:
        """Update the probability with a keyframe; for the arguments see `cost`."""
        right, faulty = self._likelihoods(surprise, faulty_cost, returned_cost)
        share = faulty / (right + faulty)
        self.probability = _LASTS * share + _BEGINS * (1.0 - share)
        if not self.is_suspected:
            self.forget()

    def remember(self, by_odometry: SE2, by_scan: SE2, deviations: Deviations) -> None:
        """Remember how the scan of a keyframe corrected the pose by odometry, if a fault is suspected.

        Both poses are those of one frame of the robot in the map.
        """
        if self.is_suspected:
            correction = by_odometry @ by_scan.inverse()
            self._T_before_now = (self._T_before_now or SE2.identity()) @ correction
            along, across, turn = (v + d * d for v, d in zip(self._variances, deviations, strict=True))
            self._variances = along, across, turn

    def forget(self) -> None:
        """Forget the odometry before the fault, since its motion began anew."""
        self._T_before_now, self._variances = None, (0.0, 0.0, 0.0)

    def _likelihoods(self, surprise: float, faulty_cost: float, returned_cost: float) -> tuple[float, float]:
        """Return the likelihoods of both states with their probabilities: right, faulty."""
        right = math.exp(-student_cost(surprise))
        if returned_cost < math.inf:
            right = 0.5 * (right + math.exp(-returned_cost))
        return (1.0 - self.probability) * right, self.probability * math.exp(-faulty_cost)


def faulty_cost(right: Deviations, inertia: Deviations) -> float:
    """Return the negative log-likelihood of a pose under faulty odometry, less that of the mean of right odometry.

    The arguments are the deviations of the pose by the odometry and by inertia. Under a fault, the robot is equally
    likely anywhere within a deviation of its pose by inertia. The longer the time between two scans, the more places it
    can reach, and the less likely is each. Without this cost, mit-csail with a scan each metre errs by 1 m instead of
    0.02 m.
    """
    return math.log(_WITHIN * math.prod(inertia) / math.prod(right))
