"""What watches over a drive: notices what goes wrong, says when, and leaves out beams that the robot itself blocks."""

import logging
import math
from collections.abc import Iterable, Sequence

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.blocked_beams import BlockedBeamsConfig, LaserView
from tbmslam.monitoring.incidents import SOON_S, EndWarning, Incidents
from tbmslam.monitoring.odometry_check import OdometryCheck, OdometryCheckConfig
from tbmslam.monitoring.scan_consistency import DISAGREE, Contradictions, agreeing_share
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe
from tbmslam.tracking.tracker import PosePrior, ScanMatch

logger = logging.getLogger(__name__)

_SAID_AT_MOST = 20
_SAME_PLACE = 0.5
"""Share of the last scan that a scan of the same place confirms at least."""
_CARRIED = "if the robot was carried or took a lift, split the recording there with --interval"
LOST = f"the scan matches nothing near the pose of the odometry: the drive continues by odometry; {_CARRIED}"
LOST_WITHOUT_ODOMETRY = f"the scan matches nothing known: without odometry the motion is a guess there; {_CARRIED}"


class DriveMonitor:
    """Watches over one drive.

    Parameters
    ----------
    beams, odometry
        When something is wrong.

    Attributes
    ----------
    incidents
        What went wrong, and when.
    whole_drive_warnings
        Subjects of warnings that the end of the drive told.
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
        """Return the reading without beams that are known to be blocked; look at its odometry."""
        self._last_stamp = reading.scan.stamp
        if self._odometry.jumps(reading.scan.stamp, reading.T_odom_robot):
            self.incidents.add(reading.scan.stamp, "the odometry jumps")
        if self._view is None:
            return reading
        scan = self._view.cleaned(reading.scan)
        return reading if scan is reading.scan else reading.with_scan(scan)

    def check(self, scan: LaserScan, match: ScanMatch, prior: PosePrior) -> None:
        """Note what is wrong with where a scan was placed."""
        if prior.jump:
            self._note_jump(scan.stamp, prior.jump)
        what = self._contradictions.told_by(scan.stamp, match, prior)
        if match.is_lost and self._shows_another_place(scan, match.T_map_sensor):
            self.incidents.add(scan.stamp, LOST if prior.by_odometry else LOST_WITHOUT_ODOMETRY)
        elif what:
            self.incidents.add(scan.stamp, what)
        self._before = scan, match.T_map_sensor

    def note_keyframe(self, reading: Reading, T_map_robot: SE2) -> None:
        """Compare the odometry's motion with what was found, and look for beams that the robot blocks."""
        if self._odometry.disagrees(reading.T_odom_robot, T_map_robot):
            self.incidents.add(reading.scan.stamp, DISAGREE)
        if self._view is not None:
            self._view.look(reading.T_odom_robot or T_map_robot)

    def cleared_keyframes(self, keyframes: Sequence[TrackedKeyframe]) -> Sequence[TrackedKeyframe]:
        """Return earlier keyframes without the beams that turned out to be blocked."""
        view = self._view
        if view is None or not view.were_any_blocked():
            return keyframes
        cleared = ((keyframe, scan, view.cleared(scan)) for keyframe in keyframes for scan in [keyframe.scan])
        return [keyframe if after is before else keyframe.with_scan(after) for keyframe, before, after in cleared]

    def warn_of_whole_drive(self, subject: str, what: str, start: float) -> None:
        """Note what holds for the whole drive since a stamp [s], once for each subject."""
        if self._last_stamp is not None and subject not in self.whole_drive_warnings:
            self.incidents.conclude(start, what, self._last_stamp - start, all_along=True)
            self.whole_drive_warnings.add(subject)

    def reopen(self) -> None:
        """Take back what the end of the drive told, as it goes on or ends anew."""
        if self.whole_drive_warnings:
            self.incidents.reopen()
            self.whole_drive_warnings.clear()

    def warn_at_end(self, warnings: Iterable[EndWarning], start: float) -> None:
        """Note what only a whole drive tells, that began at a stamp [s]."""
        for warning in warnings:
            if warning.all_along:
                self.warn_of_whole_drive(warning.subject, warning.what, start)
            else:
                self.incidents.conclude(warning.stamp, warning.what, warning.seconds)
                self.whole_drive_warnings.add(warning.subject)

    def log(self, name: str, start: float) -> None:
        """Log the incidents of a robot of some name, with the time since a stamp [s]."""
        for number, incident in enumerate(self.incidents):
            if number == _SAID_AT_MOST:
                logger.warning("%s: and %d more", name, self.incidents.number - number)
                return
            logger.warning("%s: %s", name, incident.text(start))

    def _shows_another_place(self, scan: LaserScan, T_map_sensor: SE2) -> bool:
        """Return whether a scan contradicts the one before, or else it shows what nobody has seen yet."""
        if self._before is None:
            return False
        before, T_map_before = self._before
        return agreeing_share(before, scan, T_map_before.to(T_map_sensor)) < _SAME_PLACE

    def _note_jump(self, stamp: float, metres: float) -> None:
        """Note that the odometry steps too far to be believed, once where it goes on to do so."""
        number, until = self._stepping
        if 0.0 <= stamp - until <= SOON_S:
            self.incidents.lengthen(number, stamp)
        else:
            number = self.incidents.add(stamp, f"the odometry steps by {metres:.0f} m, which is ignored")
        self._stepping = number, stamp
