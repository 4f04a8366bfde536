"""The angle between the beams of a laser whose stated step may have been stretched, found out by trial."""

import math

from tbmslam.back_end import BackEnd
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.front_end import Placement
from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.paired_gains import PairedGains
from tbmslam.sensing.laser_scan import Reading
from tbmslam.sensing.stretched_angles import round_step_deg, unstretched
from tbmslam.tracked_drive import TrackedDrive
from tbmslam.tracking.surfel_tracker import SurfelTrackerConfig

_GROUP_M = 1.0
"""Travelled length in which scans err alike and count as one [m]."""
_SURE = 3.5
"""Standard deviations from which the other step is used. Stated steps that are wrong reach 5 to 11 over whole drives
(aces, intel, mit-killian); where the stated step is right, the other one reaches -10 to -3."""
_CERTAIN = 5.0
"""Standard deviations from which the drive is tracked only once: chance exceeds them in 4 of a million drives."""


class AngleStepTrial:
    """Tracks a drive a second time with the round step, until one of both steps fits better.

    A wrong step lowers the share of each scan that fits earlier ones. The difference is small, so that mostly the whole
    drive counts.

    Attributes
    ----------
    rival
        The drive with the round step.
    """

    def __init__(self, config: SlamConfig, back_end: BackEnd, finding: str) -> None:
        self.rival = TrackedDrive(config, back_end, unstretched, finding)
        self._gains = PairedGains()
        self._last: SE2 | None = None
        self._travelled = 0.0

    @classmethod
    def of(cls, reading: Reading, config: SlamConfig, back_end: BackEnd) -> "AngleStepTrial | None":
        """Return the trial of a drive that begins with a reading; None if its angles were hardly stretched."""
        beams, stated = len(reading.scan.ranges), reading.scan.angle_increment
        step = round_step_deg(beams, stated)
        if step is None or not isinstance(config.tracker, SurfelTrackerConfig):
            return None
        apart = f"{step:g} degrees apart, not {math.degrees(abs(stated)):.4f}"
        return cls(config, back_end, f"scans fit better where beams are {apart}: they are read so")

    def observe(self, reading: Reading, placement: Placement) -> Placement:
        """Return the rival placement of a reading, which was placed with its stated step."""
        other = self.rival.add(reading)
        last, pose = self._last, placement.T_map_robot
        self._last = pose
        self._gains.add(other.match.score - placement.match.score)
        self._travelled += 0.0 if last is None else math.hypot(pose.x - last.x, pose.y - last.y)
        if self._travelled >= _GROUP_M:
            self._travelled = 0.0
            self._gains.end_group()
        return other

    def is_decided(self) -> bool:
        """Return whether the trial can end before the drive does."""
        return abs(self._gains.deviations()) >= _CERTAIN

    def is_better(self) -> bool:
        """Return whether the round step fits better so far."""
        return self._gains.deviations() >= _SURE
