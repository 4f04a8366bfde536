"""Poses of a robot over time."""

import math
from dataclasses import dataclass

import numpy as np

from tbmslam.geometry.se2 import SE2, FloatArray, compose


@dataclass(frozen=True, repr=False)
class Trajectory:
    """Poses over time."""

    stamps: FloatArray
    """Times (N,) [s], in the order of the recording (not sorted: some recorders step back)."""
    poses: FloatArray
    """Poses (N, 3): x [m], y [m], theta [rad]."""

    def __post_init__(self) -> None:
        """Check that stamps and poses are finite and of equal number."""
        if self.stamps.ndim != 1 or self.poses.shape != (len(self.stamps), 3):
            raise ValueError(
                f"stamps (N,) and poses (N, 3) must agree in length, got {self.stamps.shape}, {self.poses.shape}"
            )
        if not (np.isfinite(self.stamps).all() and np.isfinite(self.poses).all()):
            raise ValueError("stamps and poses must be finite")

    def __repr__(self) -> str:
        """Return one line: the number of poses and the driven distance."""
        return f"Trajectory({len(self)} poses, {self.driven():.1f} m)"

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.stamps)

    def pose(self, index: int) -> SE2:
        """Return one pose."""
        return SE2.from_array(self.poses[index])

    def transformed(self, T_new_old: SE2) -> "Trajectory":
        """Return the trajectory in another frame."""
        return Trajectory(self.stamps, compose(np.array([T_new_old]), self.poses))

    def driven(self) -> float:
        """Return the driven distance [m]; motions within `_REST_M` of the last counted position are ignored.

        The estimated poses of a robot at rest differ by millimetres from scan to scan, over hours by tens of metres.
        """
        if not len(self):
            return 0.0
        places = self.poses[:, :2].tolist()
        length, here = 0.0, places[0]
        for place in places:
            step = math.dist(here, place)
            if step > _REST_M:
                length, here = length + step, place
        return length + math.dist(here, places[-1])

    def length(self) -> float:
        """Return the length of the line through all poses [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum()) if len(self) > 1 else 0.0


_REST_M = 0.05  # largest distance between poses of a robot at rest [m]
_SHORTEST_S, _FASTEST, _FASTEST_TURN = 1e-3, 5.0, 2.0
"""Least time between poses [s], and largest speed [m/s] and turn rate [rad/s] of a robot indoors."""


def elapsed_times(stamps: FloatArray) -> FloatArray:
    """Return the times (N,) since the first stamp; steps back count as no time [s]."""
    return np.cumsum(np.maximum(np.diff(stamps, prepend=stamps[:1]), 0.0))


def drive_speeds(stamps: FloatArray, poses: FloatArray) -> FloatArray:
    """Return the forward speeds (K,) of a robot [m/s] at poses (K, 3), K > 1; see `turn_rates` for stamps."""
    steps = np.gradient(poses[:, :2], axis=0)
    ahead = np.cos(poses[:, 2]) * steps[:, 0] + np.sin(poses[:, 2]) * steps[:, 1]
    return _per_second(ahead, stamps, _FASTEST)


def turn_rates(stamps: FloatArray, headings: FloatArray) -> FloatArray:
    """Return the turn rates (K,) of a robot [rad/s] at headings (K,) [rad] and times (K,) [s], K > 1.

    If the clock stands or steps back, the rate is unknown and counts as zero, so that it has no influence.
    """
    return _per_second(np.gradient(np.unwrap(headings)), stamps, _FASTEST_TURN)


def _per_second(steps: FloatArray, stamps: FloatArray, fastest: float) -> FloatArray:
    times = np.gradient(stamps)
    speeds: FloatArray = np.where(times > _SHORTEST_S, steps / np.maximum(times, _SHORTEST_S), 0.0)
    return speeds.clip(-fastest, fastest)
