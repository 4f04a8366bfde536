"""Where a robot was, and when."""

from dataclasses import dataclass

import numpy as np

from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angles


@dataclass(frozen=True)
class Trajectory:
    """Poses over time.

    Parameters
    ----------
    stamps
        Times (N,) [s], in the order of the recording (not sorted: some recorders step back).
    poses
        Poses (N, 3): x [m], y [m], theta [rad].
    """

    stamps: FloatArray
    poses: FloatArray

    def __post_init__(self) -> None:
        """Check that stamps and poses are numbers and belong together."""
        if self.stamps.ndim != 1 or self.poses.shape != (len(self.stamps), 3):
            raise ValueError(
                f"stamps (N,) and poses (N, 3) must agree in length, got {self.stamps.shape}, {self.poses.shape}"
            )
        if not (np.isfinite(self.stamps).all() and np.isfinite(self.poses).all()):
            raise ValueError("stamps and poses must be finite")

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.stamps)

    def pose(self, index: int) -> SE2:
        """Return one pose."""
        return SE2.from_array(self.poses[index])

    def transformed(self, T_new_old: SE2) -> "Trajectory":
        """Return the same drive in another frame."""
        moved = np.empty_like(self.poses)
        moved[:, :2] = T_new_old.apply(self.poses[:, :2])
        moved[:, 2] = wrap_angles(self.poses[:, 2] + T_new_old.theta)
        return Trajectory(self.stamps, moved)

    def length(self) -> float:
        """Return the travelled distance [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum()) if len(self) > 1 else 0.0
