"""The ratio of a true deviation of motions to the stated one, estimated from the registration of scans.

The square of a correction is weighted by the share that the scan determined, so nothing is learnt along a featureless
wall (D. MacKay, "Bayesian interpolation", 1992: the variance of a prior is the sum of squares over the number of
well-determined parameters). Slips are outliers of Student's t distribution and have little weight.
"""

import math

_LEAST, _MOST = 0.05, 20.0
"""Bounds of the factor: scans themselves err by a few millimetres from keyframe to keyframe."""

_FORGOTTEN = 1e-6
"""Weight of all corrections below which the factor stays as it is."""

_OWN = 0.1
"""Share of the variance of a correction that the motion explains, below which the correction counts less. After a gap
in the scans the keyframe's own pose explains nearly all. If it counted fully, the odometry of mit-csail would be taken
as perfect for 300 keyframes."""


class NoiseFactor:
    """Estimates the factor of one axis."""

    def __init__(self, memory: float, certainty: float) -> None:
        self._kept = math.exp(-1.0 / memory)
        self._squares = self._determined = certainty
        self.value = 1.0

    def learn(self, weight: float, error: float, deviation: float, moved: float, share: float) -> None:
        """Learn from a correction.

        `weight` is that of Student's t distribution, `deviation` that of the prior pose, `moved` that of the motion
        alone, with the present factor, and `share` the part that the scan determined, in [0, 1].
        """
        own = moved / self.value
        # The part of the correction that the keyframe's own pose explains says nothing about the motion.
        explained = share * (deviation * deviation - moved * moved)
        of_motion = moved / deviation
        counts = min(of_motion * of_motion / _OWN, 1.0)
        counts *= counts
        self._squares = self._kept * self._squares + counts * (weight * error * error - explained) / (own * own)
        self._determined = self._kept * self._determined + counts * share
        if self._determined > _FORGOTTEN:  # both sums fade where nothing is learnt
            self.value = min(max(math.sqrt(max(self._squares / self._determined, 0.0)), _LEAST), _MOST)
