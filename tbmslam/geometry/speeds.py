"""How fast a robot drove and turned, by its poses and by stamps that may be anything."""

import numpy as np

from tbmslam.geometry.se2 import FloatArray

_SHORTEST_S, _FASTEST, _FASTEST_TURN = 1e-3, 5.0, 2.0
"""No two poses lie closer in time, and no robot indoors drives or turns faster [s], [m/s], [rad/s]."""


def drive_speeds(stamps: FloatArray, poses: FloatArray) -> FloatArray:
    """Return how fast a robot drove ahead (K,) [m/s] at poses (K, 3), two at least; see `turn_rates` for stamps."""
    steps = np.gradient(poses[:, :2], axis=0)
    ahead = np.cos(poses[:, 2]) * steps[:, 0] + np.sin(poses[:, 2]) * steps[:, 1]
    return _per_second(ahead, stamps, _FASTEST)


def turn_rates(stamps: FloatArray, headings: FloatArray) -> FloatArray:
    """Return how fast a robot turned (K,) [rad/s] at headings (K,) [rad], two at least.

    Parameters
    ----------
    stamps
        Times (K,) [s]. Where the clock stands or steps back nobody knows how fast it was: that counts as not at all,
        which has no say in what follows from speeds, while the fastest there is would have the most.
    """
    return _per_second(np.gradient(np.unwrap(headings)), stamps, _FASTEST_TURN)


def _per_second(steps: FloatArray, stamps: FloatArray, fastest: float) -> FloatArray:
    times = np.gradient(stamps)
    speeds: FloatArray = np.where(times > _SHORTEST_S, steps / np.maximum(times, _SHORTEST_S), 0.0)
    return speeds.clip(-fastest, fastest)
