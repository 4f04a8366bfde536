"""Other ways to read the scans of a laser that its driver may have described wrong, found out by trial."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from tbmslam.back_end import BackEnd
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.front_end import Placement
from tbmslam.geometry.se2 import wrap_angle
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.sensing.stretched_angles import round_step_deg, unstretched
from tbmslam.tracked_drive import TrackedDrive
from tbmslam.tracking.surfel_tracker import SurfelTrackerConfig


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


BACKWARDS = "the laser measures the beams of each scan in the opposite order: the motion is compensated in that order"

_SURE = 3.5
"""Standard deviations from which the other way is used: chance exceeds them in 0.2 %.

Stated steps that are wrong reach 5 to 11 over whole drives (aces, intel, mit-killian). Where the stated step is right,
the other step reaches -10 to -3.
"""


@dataclass(frozen=True)
class OtherReading:
    """Another way to read the scans, and what tells it from the stated one."""

    corrected: Callable[[LaserScan], LaserScan]
    finding: str
    """The reason for the other way, for the user."""
    share: Callable[[Placement, Placement], float]
    """Returns the share of a group that a scan is, by the placement before it and its own. Scans of a group err alike.
    A scan with share 0 does not tell the two ways apart."""
    certain: float
    """Standard deviations from which the drive is tracked only once."""
    enough: float = math.inf
    """Groups after which a difference that decides nothing is none."""


def other_order(reading: Reading, config: SlamConfig) -> OtherReading | None:
    """Return the opposite order of the beams; None if a drive's first scan states no time between beams.

    Many scanners turn clockwise, and their drivers turn the scan around, so that angles increase, but not the times:
    the last beam was measured first (Slamtec/rplidar_ros issue 55; the lasers of TurtleBot 3 and 4). The compensation
    of the robot's motion then doubles the distortion of each scan in a turn. In seven recordings with RPLIDARs the
    share of a scan that fits grows by 0.04 to 0.13 if the scans are turned around. In six with a Hokuyo it falls by
    0.01 to 0.08.
    """
    is_used = config.deskew.enabled and reading.scan.sweep() > 0.0
    return OtherReading(LaserScan.backwards, BACKWARDS, _turning_scan, _SURE, 100) if is_used else None


def other_step(reading: Reading) -> OtherReading | None:
    """Return the step before it was stretched; None if the angles of a drive's first scan were hardly stretched.

    The share of a scan that fits changes so little that mostly the whole drive counts. Chance exceeds 5 standard
    deviations in 4 of a million drives.
    """
    step = round_step_deg(len(reading.scan.ranges), reading.scan.angle_increment)
    if step is None:
        return None
    apart = f"{step:g} degrees apart, not {math.degrees(abs(reading.scan.angle_increment)):.4f}"
    finding = f"scans fit better where beams are {apart}: they are read so"
    return OtherReading(unstretched, finding, _metres, 5.0)


class ReadingTrial:
    """Tracks a drive a second time with scans read in another way, until one of both ways fits better.

    The ways are compared by the share of each scan that fits earlier scans.

    Attributes
    ----------
    rival
        The drive with the scans read in the other way.
    """

    def __init__(self, other: OtherReading, config: SlamConfig, back_end: BackEnd) -> None:
        self.rival = TrackedDrive(config, back_end, other.corrected, other.finding)
        self._other = other
        self._last: Placement | None = None
        self._gains = PairedGains()

    @classmethod
    def of(
        cls, reading: Reading, config: SlamConfig, back_end: BackEnd, is_step_known: bool = False
    ) -> "ReadingTrial | None":
        """Return the trial of a drive that begins with a reading; None if its scans give no reason for one.

        Scans that state a time between beams are recent. They are tried in the opposite order, but with the stated
        step, since only converters of old logs stretched angles.
        """
        if not isinstance(config.tracker, SurfelTrackerConfig):
            return None
        other = other_order(reading, config)
        if other is None and not is_step_known:
            other = other_step(reading)
        return None if other is None else cls(other, config, back_end)

    def observe(self, reading: Reading, placement: Placement) -> Placement:
        """Return the rival placement of a reading, which was placed as it is stated."""
        other = self.rival.add(reading)
        if self._last is not None:
            self._gains.add(other.match.score - placement.match.score, self._other.share(self._last, placement))
        self._last = placement
        return other

    def is_decided(self) -> bool:
        """Return whether the trial can end before the drive does."""
        return self._gains.groups >= self._other.enough or abs(self._gains.deviations()) >= self._other.certain

    def is_better(self) -> bool:
        """Return whether the other way fits better so far."""
        return self._gains.deviations() >= _SURE


def _turning_scan(last: Placement, placement: Placement) -> float:
    """Return 1/3 if the robot turned by at least 0.01 rad during a scan, else 0: three such scans err alike."""
    pause = placement.scan.stamp - last.scan.stamp
    turn = abs(wrap_angle(placement.T_map_robot.theta - last.T_map_robot.theta))
    return 1.0 / 3.0 if pause > 0.0 and turn * placement.scan.sweep() >= 0.01 * pause else 0.0


def _metres(last: Placement, placement: Placement) -> float:
    """Return the travelled length: the scans of one metre err alike."""
    step = last.T_map_robot.to(placement.T_map_robot)
    return math.hypot(step.x, step.y)
