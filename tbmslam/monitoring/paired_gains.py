"""The gain of one way to read the scans over another, and its significance."""

import math


class PairedGains:
    """Sums gains in groups, since neighbouring scans err alike.

    Attributes
    ----------
    groups
        Number of complete groups.
    """

    def __init__(self) -> None:
        self.groups = 0
        self._share, self._group, self._size = 0.0, 0.0, 0  # part, sum and number of gains of the current group
        self._sum, self._squares = 0.0, 0.0

    def add(self, gain: float, share: float) -> None:
        """Add the gain of a scan that is a share of a group; a scan with share 0 does not count."""
        if share <= 0.0:
            return
        self._share, self._group, self._size = self._share + share, self._group + gain, self._size + 1
        if self._share >= 1.0:
            mean = self._group / self._size
            self._share, self._group, self._size = 0.0, 0.0, 0
            self.groups, self._sum, self._squares = self.groups + 1, self._sum + mean, self._squares + mean * mean

    def deviations(self) -> float:
        """Return the gain in standard deviations.

        Chance exceeds z with a probability of at most exp(-z^2 / 2), whatever the symmetric distribution of the gains.
        """
        return self._sum / math.sqrt(self._squares) if self._squares > 0.0 else 0.0
