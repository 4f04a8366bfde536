"""Odometry at the stamp of each scan, in one pass and with bounded memory.

Odometry poses are buffered until those around a scan are known, and interpolated at the stamp of the scan.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from datasets.counts import ReadingCounts
from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan, Reading

if TYPE_CHECKING:
    from datasets.odometry.source import NoMotion


class FoundPose(NamedTuple):
    """A pose at a time, and whether it was extrapolated."""

    pose: SE3
    carried_on: bool


class PoseHistory:
    """The newest poses, fewer than twice `capacity`, in the order of arrival, with lookup by stamp.

    Some recorders step back in time while the robot drives on. Sorting by stamp would then mix two parts of the drive.
    The poses therefore stay in their order, as runs of rising stamps, and a stamp is looked up in the newest run that
    contains it. `received` counts all poses, and `first_stamp` is the earliest stamp [s].
    """

    def __init__(self, capacity: int = 20_000) -> None:
        self._capacity = capacity
        self._stamps: list[float] = []
        self._poses: list[SE3] = []
        self._runs: list[int] = []
        self.received = 0
        self.first_stamp: float | None = None

    def add(self, stamp: float, pose: SE3) -> None:
        """Append the pose recorded next."""
        if not self._stamps or stamp < self._stamps[-1]:
            self._runs.append(len(self._stamps))
        if self.first_stamp is None or stamp < self.first_stamp:  # the clock was set back
            self.first_stamp = stamp
        self._stamps.append(stamp)
        self._poses.append(pose)
        self.received += 1
        if len(self._stamps) >= 2 * self._capacity:
            self._forget(len(self._stamps) - self._capacity)

    def reaches(self, stamp: float) -> bool:
        """Return whether the newest run has reached a stamp."""
        return bool(self._stamps) and self._stamps[-1] >= stamp

    def bracket(self, stamp: float) -> tuple[int, int] | None:
        """Return the indices of the poses before and after a stamp, in the newest run that holds it."""
        end = len(self._stamps)
        for start in reversed(self._runs):
            after = bisect_right(self._stamps, stamp, start, end)
            if after > start and self._stamps[after - 1] == stamp:
                return after - 1, after - 1
            if start < after < end:
                return after - 1, after
            end = start
        return None

    def at(self, stamp: float, longest_gap_s: float, limit_s: float) -> "FoundPose | None":
        """Return the pose at a stamp [s], interpolated or extrapolated from the nearest recorded pose.

        Gaps above `longest_gap_s` are not interpolated. Poses are extrapolated by at most `limit_s`, at the end or into
        a gap.
        """
        bracket = self.bracket(stamp)
        if bracket is None:
            carried = self._extrapolate(stamp, limit_s)
            return FoundPose(carried, True) if carried is not None else None
        before, after = bracket
        if self._stamps[after] - self._stamps[before] <= longest_gap_s:
            return FoundPose(self._within(before, after, stamp), False)
        if stamp - self._stamps[before] <= limit_s:
            return FoundPose(self._poses[before], True)
        return FoundPose(self._poses[after], True) if self._stamps[after] - stamp <= limit_s else None

    def _within(self, before: int, after: int, stamp: float) -> SE3:
        """Interpolate between two poses, or extrapolate beyond them."""
        if before == after:
            return self._poses[before]
        fraction = (stamp - self._stamps[before]) / (self._stamps[after] - self._stamps[before])
        return self._poses[before].interpolate(self._poses[after], fraction)

    def _extrapolate(self, stamp: float, limit_s: float) -> SE3 | None:
        """Extrapolate by the newest motion to a stamp; None if that is too far ahead or nothing is known."""
        if not self._stamps or not 0.0 <= stamp - self._stamps[-1] <= limit_s:
            return None
        last = len(self._stamps) - 1
        before = last - 1
        # A motion across a long pause is not the present motion.
        moving = before >= self._runs[-1] and 0.0 < self._stamps[last] - self._stamps[before] < 1.0
        return self._within(before, last, stamp) if moving else self._poses[last]

    def nearest(self, stamp: float) -> SE3 | None:
        """Return the interpolated pose, constant beyond the ends: for parts of the robot that hardly move."""
        if not self._stamps:
            return None
        bracket = self.bracket(stamp)
        if bracket is not None:
            return self._within(*bracket, stamp)
        return self._poses[-1] if stamp >= self._stamps[-1] else self._poses[self._runs[-1]]

    def _forget(self, number: int) -> None:
        """Drop the oldest poses."""
        del self._stamps[:number]
        del self._poses[:number]
        kept = [start - number for start in self._runs if start > number]
        self._runs = [0, *kept]


EXTRAPOLATION_LIMIT_S = 0.2
_MOST_WAITING = 5000


class _Waiting(NamedTuple):
    """A scan that waits for odometry, its first and its last beam by the clock of the odometry [s]."""

    scan: LaserScan
    stamp: float
    end: float
    since: float
    poses_then: int


class Pairing:
    """Holds scans back until the odometry around their stamps has arrived; keeps the order of the recording.

    The time of a scan's odometry is its stamp plus `clock_offset` [s]; the scan keeps its stamp. `odometry_scale`
    multiplies the lengths of the odometry. After `patience_s` of bag time, which is also the longest interpolated gap
    between two poses [s], a scan is answered without odometry. Scans before the first pose are dropped.
    """

    def __init__(
        self, motion: "NoMotion", counts: ReadingCounts, clock_offset: float, odometry_scale: float, patience_s: float
    ) -> None:
        self._motion = motion
        self._histories = motion.histories()
        self._counts = counts
        self._clock_offset = clock_offset
        self._odometry_scale = odometry_scale
        self._patience_s = patience_s
        self._waiting: deque[_Waiting] = deque()
        self._last_stamp = float("-inf")
        self._missing: int | None = None

    def add(self, scan: LaserScan, now: float) -> None:
        """Append the scan recorded at bag time `now` [s]."""
        stamp = scan.stamp + self._clock_offset
        end = stamp + scan.sweep() if scan.time_increment else stamp
        # A stamp that steps back may belong to odometry that is about to step back, too: wait for the next pose.
        poses_then = self._received() if stamp < self._last_stamp else -1
        self._last_stamp = stamp
        self._waiting.append(_Waiting(scan, stamp, end, now, poses_then))

    def ready(self, now: float) -> Iterable[Reading]:
        """Return the readings that can be answered at bag time `now` [s]."""
        return self._due(now) if self._waiting else ()

    def _due(self, now: float) -> Iterator[Reading]:
        """Yield the waiting scans' readings that can be answered."""
        while self._waiting:
            front = self._waiting[0]
            waited = now - front.since
            given_up = waited > self._patience_s or len(self._waiting) > _MOST_WAITING
            if not given_up and not self._has_arrived(front):
                return
            self._waiting.popleft()
            reading = self._answer(front)
            if reading is not None:
                yield reading

    def rest(self) -> Iterator[Reading]:
        """Yield the readings of the waiting scans after the last odometry."""
        while self._waiting:
            reading = self._answer(self._waiting.popleft())
            if reading is not None:
                yield reading

    def _received(self) -> int:
        """Return the number of poses that have arrived."""
        return sum(history.received for history in self._histories)

    def _has_arrived(self, waiting: _Waiting) -> bool:
        """Return whether the odometry has passed a scan."""
        for history in self._histories:
            if not history.reaches(waiting.end):
                return False
        return waiting.poses_then < 0 or not self._histories or self._received() > waiting.poses_then

    def _answer(self, waiting: _Waiting) -> Reading | None:
        """Return the reading of a scan. It has no odometry where odometry is missing for long.

        A scan before the first pose is counted as dropped; then return None.
        """
        poses = []
        carried_on = False
        for history in self._histories:
            if history.first_stamp is None or waiting.stamp < history.first_stamp:
                self._counts.drop("before_odometry")
                return None
            found = history.at(waiting.stamp, self._patience_s, EXTRAPOLATION_LIMIT_S)
            if found is not None:
                poses.append(found.pose)
                carried_on = carried_on or found.carried_on
        self._counts.extrapolated += carried_on
        self._counts.scans_used += 1
        is_known = len(poses) == len(self._histories)
        if is_known:
            self._missing = None
        else:
            self._note_missing(waiting.scan.stamp)
        mounting, upside_down = self._motion.mounting(waiting.stamp)
        scan = turned_over(waiting.scan) if upside_down else waiting.scan
        T_odom_robot = self._odometry(poses) if is_known else None
        T_odom_swept = self._swept(waiting) if is_known and waiting.end > waiting.stamp else None
        return Reading(scan, T_odom_robot, mounting, T_odom_swept)

    def _swept(self, waiting: _Waiting) -> SE2 | None:
        """Return T_odom_robot at a scan's last beam; None if the odometry does not reach it."""
        if not self._histories:
            return None
        found = [history.at(waiting.end, self._patience_s, 0.0) for history in self._histories]
        return self._odometry([each.pose for each in found if each is not None]) if all(found) else None

    def _odometry(self, poses: list[SE3]) -> SE2 | None:
        """Return T_odom_robot with lengths in metres."""
        T_odom_robot = self._motion.odometry(poses)
        return None if T_odom_robot is None else scaled(T_odom_robot, self._odometry_scale)

    def _note_missing(self, stamp: float) -> None:
        """Note when odometry ends and how long it is missing."""
        incidents = self._counts.incidents
        self._counts.without_odometry += 1
        if self._missing is None:
            self._missing = incidents.add(stamp, "no odometry: scan matching alone estimates the motion")
        incidents.lengthen(self._missing, stamp)


def scaled(T_odom_robot: SE2, scale: float) -> SE2:
    """Return a pose with its lengths multiplied."""
    if scale == 1.0:
        return T_odom_robot
    return SE2(scale * T_odom_robot.x, scale * T_odom_robot.y, T_odom_robot.theta)


def turned_over(scan: LaserScan) -> LaserScan:
    """Return the scan of an upside-down laser as seen from above, with its beams reversed."""
    return replace(scan, angle_min=-scan.angle_min, angle_increment=-scan.angle_increment)
