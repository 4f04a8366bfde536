"""What a drive measured of its own motion, before loops were closed."""

from dataclasses import dataclass

import numpy as np

from tbmslam.geometry.se2 import FloatArray

_EIGENVALUES = 1e-12, 1e12
"""Of an information: nobody knows a motion to a micrometre, and beyond a kilometre a pose graph cannot be solved."""


@dataclass(frozen=True)
class DriveMotions:
    """The laser's motion from each keyframe to the next, as odometry and scans told it, and how well they knew.

    Poses after closing loops hold what a robot alone could make of its way. Together with other robots it knows more,
    and needs what was measured: where a loop bent a corridor, nothing else tells that it was straight.

    Parameters
    ----------
    steps
        Motions (S, 3): x [m], y [m], theta [rad] of the later laser as seen from the earlier.
    informations
        Inverse covariances (S, 3, 3) of an error in x, y [m] and theta [rad] in the later laser's frame.
    """

    steps: FloatArray
    informations: FloatArray

    def __post_init__(self) -> None:
        """Check that the arrays belong together and hold motions and informations."""
        count = len(self.steps)
        if self.steps.shape != (count, 3) or self.informations.shape != (count, 3, 3):
            raise ValueError(
                f"steps and informations must have shapes (S, 3) and (S, 3, 3), got {self.steps.shape} and "
                f"{self.informations.shape}"
            )
        if not (np.isfinite(self.steps).all() and np.isfinite(self.informations).all()):
            raise ValueError("steps and informations must be finite")
        transposed = np.swapaxes(self.informations, 1, 2)
        least, most = _EIGENVALUES
        eigenvalues = np.linalg.eigvalsh(self.informations)
        if not (np.allclose(self.informations, transposed) and np.all((eigenvalues > least) & (eigenvalues < most))):
            raise ValueError(
                f"informations must be symmetric and positive definite, with eigenvalues from {least:g} to {most:g}"
            )

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)
