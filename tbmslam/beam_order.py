"""The order in which a laser measures the beams of a scan, found out by trial.

Many scanners turn clockwise, and their drivers turn the scan around, so that angles increase, but not the times: the
last beam was measured first (Slamtec/rplidar_ros issue 55; the lasers of TurtleBot 3 and 4). The compensation of the
robot's motion then doubles the distortion of each scan in a turn.
"""

from tbmslam.back_end import BackEnd
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.front_end import Placement
from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.monitoring.paired_gains import PairedGains
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.tracked_drive import TrackedDrive
from tbmslam.tracking.surfel_tracker import SurfelTrackerConfig

BACKWARDS = "the laser measures the beams of each scan in the opposite order: the motion is compensated in that order"

_TURN = 0.01
"""Least turn of the robot during a scan that tells the orders apart [rad]."""
_ALIKE = 3
"""Consecutive scans of a turn that err alike and count as one."""
_SURE = 3.5
"""Standard deviations from which a difference decides: chance exceeds them in 0.2 %."""
_ENOUGH = 100
"""Groups of scans after which a difference that decides nothing is none."""


class BeamOrderTrial:
    """Tracks a drive a second time with all scans turned around, until one of both orders fits better.

    Scans during turns are compared by the share of each that fits earlier scans. In seven recordings with RPLIDARs this
    share grows by 0.04 to 0.13 if the scans are turned around. In six with a Hokuyo it falls by 0.01 to 0.08.

    Attributes
    ----------
    rival
        The drive with all scans turned around.
    """

    def __init__(self, config: SlamConfig, back_end: BackEnd) -> None:
        self.rival = TrackedDrive(config, back_end, LaserScan.backwards, BACKWARDS)
        self._last: tuple[float, SE2] | None = None
        self._gains = PairedGains()

    @classmethod
    def of(cls, reading: Reading, config: SlamConfig, back_end: BackEnd) -> "BeamOrderTrial | None":
        """Return the trial of a drive that begins with a reading; None if its scans state no time between beams."""
        is_used = config.deskew.enabled and isinstance(config.tracker, SurfelTrackerConfig)
        return cls(config, back_end) if is_used and reading.scan.sweep() > 0.0 else None

    def observe(self, reading: Reading, placement: Placement) -> Placement:
        """Return the rival placement of a reading, which was placed with its beams in the stated order."""
        other = self.rival.add(reading)
        if self._turn(placement) >= _TURN:
            self._count(other.match.score - placement.match.score)
        return other

    def is_decided(self) -> bool:
        """Return whether the trial can end."""
        return self._gains.groups >= _ENOUGH or abs(self._gains.deviations()) >= _SURE

    def is_better(self) -> bool:
        """Return whether the opposite order fits better."""
        return self._gains.deviations() >= _SURE

    def _turn(self, placement: Placement) -> float:
        """Return the angle by which the robot turned during a scan [rad], by its turn since the last scan."""
        last, stamp, pose = self._last, placement.scan.stamp, placement.T_map_robot
        self._last = stamp, pose
        if last is None or not stamp > last[0]:
            return 0.0
        return abs(wrap_angle(pose.theta - last[1].theta)) * placement.scan.sweep() / (stamp - last[0])

    def _count(self, gain: float) -> None:
        if self._gains.add(gain) == _ALIKE:
            self._gains.end_group()
