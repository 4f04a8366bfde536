"""What every scan matcher answers, and the one interface they share."""

from typing import NamedTuple, Protocol

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.sensing.laser_scan import LaserScan


class ScanMatch(NamedTuple):
    """Where a scan was taken, as far as the map can tell.

    Parameters
    ----------
    T_map_sensor
        Pose of the laser.
    score
        How well the scan agrees with the map there; its scale is the matcher's own.
    moved
        Whether the map was able to correct the initial guess at all.
    information
        Inverse covariance (3, 3) of the pose in the map's frame as the map alone sees it; None where it does not say.
    trust
        Weight of the prior's information beside it: near 0 where the prior was far off, as where wheels slipped.
    is_lost
        Whether the scan sees much and hardly anything of it was seen before.
    """

    T_map_sensor: SE2
    score: float
    moved: bool
    information: FloatArray | None = None
    trust: float = 1.0
    is_lost: bool = False


class ScanMatcher(Protocol):
    """Places a scan in a map."""

    def match(self, scan: LaserScan, grid: EvidenceGrid, initial_guess: SE2) -> ScanMatch:
        """Return where the laser was, searching from `initial_guess` (T_map_sensor)."""
        ...


def moved_from(initial_guess: SE2, pose: SE2) -> bool:
    """Tell whether a match moved its guess by more than rounding."""
    return max(abs(a - b) for a, b in zip(initial_guess, pose, strict=True)) > 1e-7
