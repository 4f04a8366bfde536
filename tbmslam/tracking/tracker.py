"""Tracking: a prior and a scan give a pose in what was learnt from earlier scans."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.odometry_noise import Deviations


class ScanMatch(NamedTuple):
    """Where a scan was taken, as far as the map can tell."""

    T_map_sensor: SE2
    """Pose of the laser."""
    score: float
    """How well the scan agrees with the map there; its scale is the matcher's own."""
    moved: bool
    """Whether the map was able to correct the initial guess at all."""
    information: FloatArray | None = None
    """Inverse covariance (3, 3) of the pose in the map's frame as the map alone sees it; None where it does not say."""
    trust: float = 1.0
    """Weight of the prior's information beside it: near 0 where the prior was far off, as where wheels slipped."""
    is_lost: bool = False
    """Whether the scan sees much and hardly anything of it was seen before."""


class ScanMatcher(Protocol):
    """Places a scan in a map."""

    def match(self, scan: LaserScan, grid: EvidenceGrid, initial_guess: SE2) -> ScanMatch:
        """Return where the laser was, searching from `initial_guess` (T_map_sensor)."""
        ...


def moved_from(initial_guess: SE2, pose: SE2) -> bool:
    """Tell whether a match moved its guess by more than rounding."""
    return max(abs(a - b) for a, b in zip(initial_guess, pose, strict=True)) > 1e-7


class Coasting(NamedTuple):
    """The robot's pose if it goes on as before: robots have inertia."""

    mean: SE2
    """T_map_robot by the robot's last motion."""
    deviations: Deviations
    """Of the mean in its own frame, since robots accelerate."""


class PosePrior(NamedTuple):
    """A prior on the robot's pose, of Student's t distribution."""

    mean: SE2
    """T_map_robot: by odometry since the last keyframe or, without odometry, by the last motion."""
    deviations: Deviations
    """Of the mean in its own frame, those of the last keyframe's pose and of the motion since then together; all zero
    for the first pose of a drive, which is where it is."""
    motion: Deviations
    """Of the motion alone."""
    start: SE2
    """T_map_robot: where the search for the scan's place begins, by odometry since the last scan."""
    coasting: Callable[[], Coasting | None]
    """Returns the pose by inertia, which holds even where the odometry is faulty; None where the mean comes from it."""
    jump: float = 0.0
    """How far the odometry stepped where no robot moves so fast, so that it was left out [m]; else 0."""
    by_odometry: bool = False
    """Whether the mean comes from odometry."""
    swerve: float = 0.0
    """How far the odometry's step since the last scan is from the robot's last motion at equal speed [m]."""


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
