"""Weighted hypotheses about a drive, who descends from whom, and when to breed anew."""

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray


class Ancestry:
    """The particles' weights and the family tree of their poses.

    Parameters
    ----------
    count
        How many particles.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._log_weights = np.zeros(count)
        self._poses: list[FloatArray] = []
        self._parents: list[npt.NDArray[np.int64]] = []
        self._ancestors = np.arange(count)

    def weights(self) -> FloatArray:
        """Return the weights (N,), which add up to one."""
        relative = np.exp(self._log_weights - self._log_weights.max())
        return np.asarray(relative / relative.sum())

    def effective_number(self) -> float:
        """Return how many equally weighted particles these are worth, N_eff = 1 / sum of squared weights (Liu 1996)."""
        return float(1.0 / np.sum(self.weights() ** 2))

    def best(self) -> int:
        """Return the particle of the largest weight."""
        return int(np.argmax(self._log_weights))

    def weigh(self, log_likelihoods: FloatArray) -> None:
        """Multiply likelihoods, given as logarithms (N,), into the weights."""
        self._log_weights = self._log_weights + log_likelihoods
        self._log_weights -= self._log_weights.max()

    def resample(self, draw: float) -> npt.NDArray[np.int64]:
        """Draw as many descendants of each particle as its weight says and return whose each new one is (N,).

        Systematic resampling: one draw in [0, 1) places a comb of N teeth over the cumulated weights.
        """
        teeth = (np.arange(self._count) + draw) / self._count
        chosen = np.searchsorted(np.cumsum(self.weights()), teeth, side="right").clip(max=self._count - 1)
        self._log_weights = np.zeros(self._count)
        self._ancestors = self._ancestors[chosen]
        return chosen

    def record(self, poses: FloatArray) -> None:
        """Append the poses (N, 3) of the particles as they are now."""
        self._poses.append(poses.copy())
        self._parents.append(self._ancestors)
        self._ancestors = np.arange(self._count)

    def path(self) -> FloatArray:
        """Return the recorded poses (K, 3) of the best particle and its ancestors."""
        path = np.empty((len(self._poses), 3))
        particle = int(self._ancestors[self.best()]) if len(path) else 0
        for step in range(len(path) - 1, -1, -1):
            path[step] = self._poses[step][particle]
            particle = int(self._parents[step][particle])
        return path
