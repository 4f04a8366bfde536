"""Steps of a drive that hardly anything determines, such as a gap in the scans, until a closure determines them."""

import numpy as np

from tbmslam.geometry.se2 import FloatArray, IntArray
from tbmslam.loop_closure.candidates import ChainDrift

_LOOSE_M, _LOOSE_RAD = 0.5, 0.5
"""Deviations from which a step is loose [m], [rad]. Those of tracked steps stay below 0.03 m and 0.01 rad on mit-csail,
intel and aces, with odometry and without. If the first scan after a gap of 8 s fits nothing, they are 1 m and 4 rad."""

_DEVIATIONS = 3.0
"""Number of standard deviations that a search window covers."""

_LARGEST_TURN = 1.5
"""Largest turn that is searched for loose steps [rad]. A larger one makes each search longer, and is left to the far
search."""


class LooseSteps:
    """The loose steps of a drive that no closure bridges yet.

    `poses` (K, 3) are the keyframes as tracked, and `covariances` (K - 1, 3, 3) those of the steps in the frame at
    their end.
    """

    def __init__(self, poses: FloatArray, covariances: FloatArray) -> None:
        position = np.linalg.eigvalsh(covariances[:, :2, :2])[:, 1]
        self._is_loose = (position > _LOOSE_M**2) | (covariances[:, 2, 2] > _LOOSE_RAD**2)
        self._poses, self._covariances = poses, covariances
        self._drift = self._summed()

    def ends(self) -> IntArray:
        """Return the keyframes (M,) at the ends of the loose steps."""
        return np.flatnonzero(self._is_loose) + 1

    def windows(self, keyframe: int, seen: IntArray) -> FloatArray:
        """Return how far off a keyframe may be, as seen from others, by the loose steps between (N, 2): [m], [rad]."""
        if self._drift is None:
            return np.zeros((len(seen), 2))
        position, heading = self._drift.deviations(seen, np.full(len(seen), keyframe))
        return _DEVIATIONS * np.column_stack((position, np.minimum(heading, _LARGEST_TURN / _DEVIATIONS)))

    def bridge(self, keyframe: int, earlier: int) -> None:
        """Note that a keyframe was registered to an earlier one, which determines the steps between."""
        if self._is_loose[earlier:keyframe].any():
            self._is_loose[earlier:keyframe] = False
            self._drift = self._summed()

    def _summed(self) -> ChainDrift | None:
        """Return the drift by the loose steps alone; None without any."""
        if not self._is_loose.any():
            return None
        return ChainDrift(self._poses, np.where(self._is_loose[:, None, None], self._covariances, 0.0))
