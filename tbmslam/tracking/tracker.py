"""The interface of trackers, which register scans to earlier scans."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.odometry_noise import Deviations


class ScanMatch(NamedTuple):
    """The pose of a scan by the map."""

    T_map_sensor: SE2
    score: float
    """Agreement of the scan with the map at the pose; each matcher has its own scale."""
    moved: bool
    """Whether the map could correct the initial guess."""
    information: FloatArray | None = None
    """Inverse covariance (3, 3) of the pose in the map's frame by the map alone; None if it is unknown."""
    trust: float = 1.0
    """Weight of the prior's information: near 0 if the prior was far off, as after a slip, or the scan is lost."""
    is_lost: bool = False
    """Whether many hits fit no earlier scan, or hardly more than chance fits within a loose prior."""


class ScanMatcher(Protocol):
    """Registers a scan on a map."""

    def match(self, scan: LaserScan, grid: EvidenceGrid, initial_guess: SE2) -> ScanMatch:
        """Return the pose of the laser, found from `initial_guess` (T_map_sensor)."""
        ...


def moved_from(initial_guess: SE2, pose: SE2) -> bool:
    """Return whether a match moved its guess by more than rounding."""
    return max(abs(a - b) for a, b in zip(initial_guess, pose, strict=True)) > 1e-7


class Coasting(NamedTuple):
    """The robot's pose if its motion continues: robots have inertia."""

    mean: SE2
    """T_map_robot by the robot's last motion."""
    deviations: Deviations
    """Standard deviations of the mean in its own frame; robots accelerate."""


LOOSE_M, LOOSE_RAD = 0.25, 0.25
"""Deviations from which a prior is loose [m], [rad]. After a gap of 4 s in the scans of mit-csail they are 0.15 m and
0.34 rad. With 0.1, drives of intel and aces with a scan each metre err by 0.2 to 0.7 m."""


class PosePrior(NamedTuple):
    """A prior on the robot's pose, of Student's t distribution."""

    mean: SE2
    """T_map_robot: by odometry since the last keyframe or, without odometry, by the last motion."""
    deviations: Deviations
    """Standard deviations of the mean in its own frame, by the last keyframe's pose and the motion since then; all zero
    for the first pose of a drive, which defines the frame."""
    motion: Deviations
    """Standard deviations of the motion since the last keyframe alone."""
    start: SE2
    """T_map_robot by odometry since the last scan: the registration starts here."""
    coasting: Callable[[], Coasting | None]
    """Returns the pose by inertia, which holds even where the odometry is faulty; None where the mean comes from it, or
    where the last pose is too old."""
    jump: float = 0.0
    """Length of an odometry step that no robot can drive, which was ignored [m]; else 0."""
    by_odometry: bool = False
    swerve: float = 0.0
    """Distance of the odometry's step since the last scan from the robot's last motion at equal speed [m]."""
    stood: Coasting | None = None
    """The pose after a pause in which the odometry moved far, if the robot stood and the odometry began anew."""

    def is_loose(self) -> bool:
        """Return whether the prior is so wide that some hits fit by chance somewhere within it."""
        along, across, heading = self.deviations
        return max(along, across) > LOOSE_M or heading > LOOSE_RAD


class Tracker(Protocol):
    """Registers scans to earlier scans.

    `grid` is the grid into which the tracker inserts every scan, and which is the map. It is None for a tracker that
    learns from keyframes alone; the map is then rendered from the keyframes.
    """

    grid: EvidenceGrid | None

    def match(self, scan: LaserScan, prior: PosePrior, T_robot_sensor: SE2) -> ScanMatch:
        """Return the pose of the laser, by a prior on the pose of the robot."""
        ...

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        """Insert the scan, so that later scans are registered on it."""
        ...

    def is_novel(self, match: ScanMatch) -> bool:
        """Return whether a scan must be inserted even if the robot hardly moved since the last keyframe."""
        ...
