"""Following the robot: placing each scan in what was learnt from earlier ones."""

from typing import Protocol

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.pose_prior import PosePrior
from tbmslam.tracking.scan_match import ScanMatch


class Tracker(Protocol):
    """Places scans in what it has learnt from earlier scans.

    Attributes
    ----------
    grid
        The grid that it writes every scan into, which then is the map; None where it learns from keyframes alone and
        the map is rendered from them.
    """

    grid: EvidenceGrid | None

    def match(self, scan: LaserScan, prior: PosePrior, T_robot_sensor: SE2) -> ScanMatch:
        """Return where the laser was.

        Parameters
        ----------
        scan
            The scan.
        prior
            Where the robot probably was.
        T_robot_sensor
            Pose of the laser on the robot.
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
