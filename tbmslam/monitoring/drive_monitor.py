"""Checks of a drive during mapping: records incidents with their times, and removes blocked beams."""

import logging
import math
from collections.abc import Iterable, Sequence

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.blocked_beams import BlockedBeamsConfig, LaserView
from tbmslam.monitoring.incidents import SOON_S, EndWarning, Incidents
from tbmslam.monitoring.odometry_check import (
    BEGAN_ANEW,
    DISAGREE,
    Contradictions,
    OdometryCheck,
    OdometryCheckConfig,
    agreeing_share,
)
from tbmslam.report.repeated_warnings import gathered
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe
from tbmslam.tracking.tracker import PosePrior, ScanMatch

logger = logging.getLogger(__name__)

_SAID_AT_MOST = 20
_SAME_PLACE = 0.5  # least share of the last scan that a scan of the same place confirms
_CARRIED = "if the robot was carried or took a lift, split the recording there with --interval"
LOST = f"the scan matches hardly anything near the pose of the odometry: its pose is uncertain; {_CARRIED}"
LOST_WITHOUT_ODOMETRY = f"the scan matches nothing known: without odometry the motion is a guess there; {_CARRIED}"


class DriveMonitor:
    """Checks one drive, and records its `incidents` with their times.

    `whole_drive_warnings` are the subjects of the warnings that were given at the end of the drive.
    """

    def __init__(self, beams: BlockedBeamsConfig, odometry: OdometryCheckConfig) -> None:
        self.incidents = Incidents()
        self._view = LaserView(beams, self.incidents) if beams.enabled else None
        self._odometry = OdometryCheck(odometry)
        self._contradictions = Contradictions()
        self._before: tuple[LaserScan, SE2] | None = None
        self._last_stamp: float | None = None
        self._stepping = 0, -math.inf
        self.whole_drive_warnings = set[str]()

    def cleaned(self, reading: Reading) -> Reading:
        """Return the reading without blocked beams."""
        self._last_stamp = reading.scan.stamp
        if self._view is None:
            return reading
        scan = self._view.cleaned(reading.scan)
        return reading if scan is reading.scan else reading.with_scan(scan)

    def check(self, scan: LaserScan, match: ScanMatch, prior: PosePrior, *, began_anew: bool = False) -> None:
        """Check the match of a scan; `began_anew` says that it showed that the odometry began anew."""
        if prior.jump:
            self._note_jump(scan.stamp, prior.jump)
        if began_anew:
            self.incidents.add(scan.stamp, BEGAN_ANEW)
        if prior.jump or began_anew:
            self._odometry.forget()
            if self._view is not None:
                self._view.forget_odometry()
        what = self._contradictions.message_of(scan.stamp, match, prior)
        if match.is_lost and self._shows_another_place(scan, match.T_map_sensor):
            self.incidents.add(scan.stamp, LOST if prior.by_odometry else LOST_WITHOUT_ODOMETRY)
        elif what:
            self.incidents.add(scan.stamp, what)
        self._before = scan, match.T_map_sensor

    def note_keyframe(self, reading: Reading, index: int, T_map_robot: SE2) -> None:
        """Compare the motions by odometry and by scans, and look for blocked beams."""
        if self._odometry.disagrees(reading.T_odom_robot, T_map_robot):
            self.incidents.add(reading.scan.stamp, DISAGREE)
        if self._view is not None:
            self._view.learn(index, T_map_robot, reading.T_odom_robot)

    def cleared_keyframes(self, keyframes: Sequence[TrackedKeyframe]) -> Sequence[TrackedKeyframe]:
        """Return keyframes without the beams that were blocked at their times."""
        view = self._view
        if view is None or not view.were_any_blocked():
            return keyframes
        scans = ((keyframe, keyframe.scan) for keyframe in keyframes)
        cleared = ((keyframe, scan, view.cleared(scan, keyframe.index)) for keyframe, scan in scans)
        return [keyframe if after is before else keyframe.with_scan(after) for keyframe, before, after in cleared]

    def warn_of_whole_drive(self, subject: str, what: str, start: float) -> None:
        """Add a warning for the whole drive since a stamp [s], once for each subject."""
        if self._last_stamp is not None and subject not in self.whole_drive_warnings:
            self.incidents.conclude(start, what, self._last_stamp - start, all_along=True)
            self.whole_drive_warnings.add(subject)

    def reopen(self) -> None:
        """Remove the warnings of the end of the drive, because the drive continues or ends again."""
        if self.whole_drive_warnings:
            self.incidents.reopen()
            self.whole_drive_warnings.clear()

    def warn_at_end(self, warnings: Iterable[EndWarning], start: float) -> None:
        """Add the warnings of a whole drive that began at a stamp [s]."""
        for warning in warnings:
            if warning.all_along:
                self.warn_of_whole_drive(warning.subject, warning.what, start)
            else:
                self.incidents.conclude(warning.stamp, warning.what, warning.seconds)
                self.whole_drive_warnings.add(warning.subject)

    def log(self, name: str, start: float) -> None:
        """Log the incidents under the robot's name, equal ones as one line, with their times since a stamp [s]."""
        lines = gathered(incident.text(start) for incident in self.incidents)
        for line in lines[:_SAID_AT_MOST]:
            logger.warning("%s: %s", name, line)
        more = max(len(lines) - _SAID_AT_MOST, 0) + self.incidents.number - len(self.incidents)
        if more:
            logger.warning("%s: and %d more", name, more)

    def _shows_another_place(self, scan: LaserScan, T_map_sensor: SE2) -> bool:
        """Return whether a scan contradicts the previous one; else it shows unexplored space."""
        if self._before is None:
            return False
        before, T_map_before = self._before
        return agreeing_share(before, scan, T_map_before.to(T_map_sensor)) < _SAME_PLACE

    def _note_jump(self, stamp: float, metres: float) -> None:
        """Add an incident for an impossible step of the odometry; steps in a row are one incident."""
        number, until = self._stepping
        if 0.0 <= stamp - until <= SOON_S:
            self.incidents.lengthen(number, stamp)
        else:
            number = self.incidents.add(stamp, f"the odometry steps by {metres:.0f} m, which is ignored")
        self._stepping = number, stamp
