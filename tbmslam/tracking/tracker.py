"""Following the robot: placing each scan in what was learnt from earlier ones."""

from collections.abc import Callable
from typing import Protocol

from tbmslam.evidence_grid import EvidenceGrid
from tbmslam.laser_scan import LaserScan
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2, FloatArray

Since = Callable[[], tuple[SE2, FloatArray]]


class Tracker(Protocol):
    """Places scans in what it has learnt from earlier scans.

    Attributes
    ----------
    grid
        The grid that it writes every scan into, which then is the map; None where it learns from keyframes alone and
        the map is rendered from them.
    sees_walkers
        Whether anything was seen to move around the last scan that was learnt, as far as the tracker looks for that.
    """

    grid: EvidenceGrid | None
    sees_walkers: bool

    def match(self, scan: LaserScan, guess: SE2, deviations: FloatArray, other_guess: Callable[[], SE2]) -> ScanMatch:
        """Return where the laser was.

        Parameters
        ----------
        scan
            The scan.
        guess
            Where it probably was, T_map_sensor.
        deviations
            The guess's standard deviations (3,) of x, y [m] and theta [rad].
        other_guess
            Returns where else it may have been, if it was not there.
        """
        ...

    def settled(self, scan: LaserScan, match: ScanMatch, since: Since | None) -> ScanMatch:
        """Return where a scan that is to be learnt was taken, now that its guess is the odometry's since the last one.

        Parameters
        ----------
        scan, match
            The scan, and where `match` has placed it.
        since
            Tells where the odometry since the last one learnt puts it, T_map_sensor, and standard deviations (3,) of
            that; most scans need not know. None where there is no such odometry, or nothing of the scan was matched.
        """
        ...

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        """Let later scans be placed by this one too."""
        ...

    def revised_poses(self) -> FloatArray | None:
        """Return where the laser was (K, 3) at everything learnt, as it looks now; None where it never looks back."""
        ...

    def is_novel(self, match: ScanMatch) -> bool:
        """Tell whether to learn from a scan however little the robot moved since the last one."""
        ...
