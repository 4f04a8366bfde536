"""What watches over a drive: notices what goes wrong, says when, and keeps the worst out of the map."""

import logging
import math

from tbmslam.laser_scan import LaserScan, Reading
from tbmslam.monitoring.blocked_beams import BlockedBeamsConfig
from tbmslam.monitoring.continuity import ContinuityConfig, changed_share, compare_scans
from tbmslam.monitoring.incidents import SOON_S, Incidents
from tbmslam.monitoring.laser_view import LaserView
from tbmslam.monitoring.odometry_check import OdometryCheck, OdometryCheckConfig
from tbmslam.monitoring.shut_in import ComingOut, ShutIn
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2

logger = logging.getLogger(__name__)

_SAID_AT_MOST = 20
LOST = "lost, the scans fit neither the map nor the odometry, as if the robot had been carried"

_REMEDY = (
    "though the wheels stood still: if the robot was carried, make one robot of the way before and one of the way "
    "after by --interval"
)
CHANGED = f"all looks different after a pause, {_REMEDY}"
MOVED = f"the robot does not stand where it stood before a pause, {_REMEDY}"
ELSEWHERE = "shut in as in a lift, and what it saw when it came out is another place, as on another floor"
_IF_A_LIFT = "if it was a lift, make one robot of the way before and one of the way after by --interval"
DOUBTFUL = f"shut in as in a lift, and what it saw when it came out differs from what was before: {_IF_A_LIFT}"
ALIKE = f"shut in as in a lift, and what it saw when it came out fits what was before: {_IF_A_LIFT}"


class DriveMonitor:
    """Watches over one drive.

    Parameters
    ----------
    continuity, beams, odometry
        When something is wrong.

    Attributes
    ----------
    incidents
        What went wrong, and when.
    said_all_along
        What things were noted about that hold for the whole drive.
    """

    def __init__(self, continuity: ContinuityConfig, beams: BlockedBeamsConfig, odometry: OdometryCheckConfig) -> None:
        self.incidents = Incidents()
        self._continuity = continuity
        self._view = LaserView(beams, self.incidents) if beams.enabled else None
        self._odometry = OdometryCheck(odometry)
        self._shut_in = ShutIn(continuity.shut_in) if continuity.enabled and continuity.shut_in.enabled else None
        self._last: tuple[LaserScan, SE2] | None = None
        self._T_map_robot = SE2.identity()
        self._stepping = 0, -math.inf
        self.said_all_along = set[str]()

    def cleaned(self, reading: Reading) -> Reading:
        """Return the reading without beams that are known to be blocked; look at its odometry."""
        if self._odometry.jumps(reading.scan.stamp, reading.T_odom_robot):
            self.incidents.add(reading.scan.stamp, "the odometry jumps")
        if self._view is None:
            return reading
        scan = self._view.cleaned(reading.scan, reading.T_odom_robot or self._T_map_robot)
        return reading if scan is reading.scan else reading.with_scan(scan)

    def checked(self, scan: LaserScan, match: ScanMatch, guess: SE2, jump: float) -> ScanMatch | None:
        """Return where a scan was taken: as it was matched, or as the odometry says; None where neither can be.

        A scan that hardly matches continues the scan before, or else it puts walls into space just seen free.

        Parameters
        ----------
        scan, match
            The scan and where it was placed.
        guess
            Where it was expected, T_map_sensor.
        jump
            How far the odometry stepped where that was not believed [m]; else 0.
        """
        last = self._last
        if jump:
            self._note_jump(scan.stamp, jump)
        found: ScanMatch | None = match
        paused = last is not None and self._stood_still(last, scan, guess)
        if last is not None and paused and self._contradicts(last, scan, guess):
            found = None
        elif (
            last is not None and self._is_doubtful(match) and not self._continues(last, scan, match.T_map_sensor, guess)
        ):
            is_there = self._continues(last, scan, guess, guess)
            found = ScanMatch(guess, match.score, moved=False) if is_there else None
        told = LOST if found is None else ""
        if last is not None and paused and found is not None:
            told = self._changed(last, scan, found, guess)
        if told:
            self.incidents.add(scan.stamp, told)
            if self._view is not None:
                self._view.forget()
        if found is None and self._shut_in is not None:
            self._shut_in.forget()
        self._last = (scan, guess if found is None else found.T_map_sensor)
        return found

    def note_keyframe(self, reading: Reading, T_map_robot: SE2) -> None:
        """Compare the odometry's motion with what was found, and take the keyframe's place for its last scan's."""
        self._T_map_robot = T_map_robot
        if self._last is not None:
            self._last = (self._last[0], T_map_robot @ reading.T_robot_sensor)
        if self._odometry.disagrees(reading.T_odom_robot, T_map_robot):
            self.incidents.add(reading.scan.stamp, "odometry and scans disagree about the motion")
        if self._view is not None:
            T_odom_robot, T_robot_sensor = reading.T_odom_robot, reading.T_robot_sensor
            by_odometry = None if T_odom_robot is None else T_odom_robot @ T_robot_sensor
            self._view.note_place(T_map_robot @ T_robot_sensor, by_odometry)

    def came_out_elsewhere(self, scan: LaserScan, T_map_sensor: SE2, T_map_robot: SE2, *, learnt: bool) -> float | None:
        """Return at which stamp a drive is to be cut, as the robot was shut in then and came out elsewhere; or None.

        Parameters
        ----------
        scan, T_map_sensor, T_map_robot
            The last scan, and where laser and robot were found.
        learnt
            Whether it is a keyframe.
        """
        if self._shut_in is None:
            return None
        before = self._shut_in.left
        found = self._shut_in.look(scan, T_map_sensor, T_map_robot)
        left = self._shut_in.left
        if left is not None and left is not before and self._view is not None:
            # Walls of another floor would stand where was seen through, as parts of the robot do.
            self._view.forget(left.middle())
        if learnt:
            found = self._shut_in.note_keyframe(scan, T_map_sensor, T_map_robot) or found
        return self._told_of(found)

    def ended_elsewhere(self) -> float | None:
        """Return the same at the end of the drive."""
        return None if self._shut_in is None else self._told_of(self._shut_in.end())

    def _told_of(self, found: ComingOut | None) -> float | None:
        """Tell of a time shut in; return at which stamp the drive is to be cut."""
        if found is None:
            return None
        since, until = found.stay.since, found.stay.until
        told = ELSEWHERE if found.elsewhere else DOUBTFUL if found.differs else ALIKE
        self.incidents.add(since, told, until - since)
        return found.stay.middle() if found.elsewhere else None

    def knows_blocked_beams(self) -> bool:
        """Tell whether any beam was blocked at any time."""
        return self._view is not None and self._view.were_any_blocked()

    def cleared(self, scan: LaserScan) -> LaserScan:
        """Return an earlier scan without the beams that turned out to be blocked."""
        return scan if self._view is None else self._view.cleared(scan)

    def note_all_along(self, about: str, what: str, start: float) -> None:
        """Note what holds for the whole drive since a stamp [s], once for each thing that it is about."""
        if self._last is not None and about not in self.said_all_along:
            self.incidents.conclude(start, what, self._last[0].stamp - start, all_along=True)
            self.said_all_along.add(about)

    def reopen(self) -> None:
        """Take back what the end of the drive told, as it goes on or ends anew."""
        self.incidents.reopen()
        self.said_all_along.clear()

    def tell(self, name: str, start: float, odometry_scale: float = 1.0) -> None:
        """Log the incidents, with the time since a stamp [s].

        Parameters
        ----------
        name, start
            The robot's name, and the stamp.
        odometry_scale
            What the odometry's lengths were multiplied by.
        """
        self._note_scale(start, odometry_scale)
        for number, incident in enumerate(self.incidents):
            if number == _SAID_AT_MOST:
                logger.warning("%s: and %d more", name, self.incidents.number - number)
                return
            logger.warning("%s: %s", name, incident.text(start))

    def _note_jump(self, stamp: float, metres: float) -> None:
        """Note that the odometry steps too far to be believed, once where it goes on to do so."""
        number, until = self._stepping
        if 0.0 <= stamp - until <= SOON_S:
            self.incidents.lengthen(number, stamp)
        else:
            number = self.incidents.add(stamp, f"the odometry steps by {metres:.0f} m, which is not believed")
        self._stepping = number, stamp

    def _note_scale(self, start: float, odometry_scale: float) -> None:
        """Note that scans and odometry differ in length all along."""
        scale = self._odometry.scale()
        if scale != 1.0:
            told = f"the scans go {_digits(scale)} times as far as the odometry, one of them has a wrong scale"
            remedy = f"where it is the odometry's, --odometry-scale {_digits(scale * odometry_scale)} mends it"
            self.note_all_along("scale", f"{told}; {remedy}", start)

    def _is_doubtful(self, match: ScanMatch) -> bool:
        return self._continuity.enabled and match.score < self._continuity.doubtful

    def _stood_still(self, last: tuple[LaserScan, SE2], scan: LaserScan, guess: SE2) -> bool:
        """Tell whether a scan comes after a pause in which the wheels stood still."""
        config = self._continuity
        if not config.enabled or scan.stamp - last[0].stamp < config.pause:
            return False
        T_last_guess = last[1].to(guess)
        return max(math.hypot(T_last_guess.x, T_last_guess.y), abs(T_last_guess.theta)) <= config.still

    def _contradicts(self, last: tuple[LaserScan, SE2], scan: LaserScan, guess: SE2) -> bool:
        """Tell whether a scan contradicts the one before, where the wheels say that the robot is."""
        comparison = compare_scans(last[0], scan, last[1].to(guess), self._continuity)
        return comparison.contradiction > self._continuity.max_contradiction

    def _changed(self, last: tuple[LaserScan, SE2], scan: LaserScan, found: ScanMatch, guess: SE2) -> str:
        """Return what changed in a pause in which the wheels stood still, in words; nothing where nothing did."""
        config = self._continuity
        by_wheels, rest = last[1].to(guess), guess.to(found.T_map_sensor)
        if compare_scans(last[0], scan, by_wheels, config).contradiction > config.max_change:
            return CHANGED
        far = config.shift + config.slack * math.hypot(by_wheels.x, by_wheels.y)
        turned = config.turn + config.slack * abs(by_wheels.theta)
        if math.hypot(rest.x, rest.y) > far or abs(math.remainder(rest.theta, math.tau)) > turned:
            return MOVED
        share = changed_share(last[0], scan, last[1].to(found.T_map_sensor), config)
        return CHANGED if share > config.max_near_change else ""

    def _continues(self, last: tuple[LaserScan, SE2], scan: LaserScan, T_map_sensor: SE2, guess: SE2) -> bool:
        """Tell whether a scan at a pose does not contradict the one before, nor the odometry for no good reason."""
        config = self._continuity
        comparison = compare_scans(last[0], scan, last[1].to(T_map_sensor), config)
        moved = guess.to(T_map_sensor)
        is_far = max(math.hypot(moved.x, moved.y), abs(moved.theta)) > config.far
        if is_far and comparison.agreement < config.min_agreement:
            return False
        if comparison.agreement < config.elsewhere and comparison.contradiction > config.max_change:
            return False
        # Late odometry puts far hits of a scan that goes on into free space too, but not most of all hits.
        return comparison.contradiction <= config.max_contradiction or comparison.agreement > config.max_agreement


def _digits(scale: float) -> str:
    """Return a scale in words, to a hundredth or two digits."""
    return f"{scale:.2f}" if scale >= 0.1 else f"{scale:.2g}"
