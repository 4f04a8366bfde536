"""Poses of one moving frame in the order in which they were recorded."""

from bisect import bisect_right
from typing import NamedTuple

from datasets.odometry.se3 import SE3


class FoundPose(NamedTuple):
    """A pose at a time, and whether it was extrapolated."""

    pose: SE3
    carried_on: bool


class PoseHistory:
    """Stamped poses as they arrive, looked up by stamp.

    Some recorders step back in time while the robot drives on. Sorting by stamp would then weave two parts of the
    drive into each other, so the poses stay in their order, as runs of rising stamps, and a stamp is looked up in the
    newest run that holds it.

    Parameters
    ----------
    capacity
        The newest poses kept; the memory stays bounded however long the recording is.

    Attributes
    ----------
    received
        How many poses came.
    first_stamp
        The earliest stamp of all of them [s]; None before the first.
    """

    def __init__(self, capacity: int = 20_000) -> None:
        if capacity < 2:
            raise ValueError(f"capacity must be at least 2, got {capacity}")
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
        if self.first_stamp is None or stamp < self.first_stamp:  # a clock that is set back begins anew
            self.first_stamp = stamp
        self._stamps.append(stamp)
        self._poses.append(pose)
        self.received += 1
        if len(self._stamps) >= 2 * self._capacity:
            self._forget(len(self._stamps) - self._capacity)

    def reaches(self, stamp: float) -> bool:
        """Return whether the newest run has come as far as this stamp."""
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
        """Return the pose at a stamp, interpolated, or carried on from the nearest recorded one.

        Parameters
        ----------
        stamp
            Time asked for [s].
        longest_gap_s
            Poses further apart than this are not interpolated [s].
        limit_s
            How far beyond a recorded pose it may be carried on, at the end or into such a gap [s].
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
        """Interpolate between two poses, or carry on beyond them."""
        if before == after:
            return self._poses[before]
        fraction = (stamp - self._stamps[before]) / (self._stamps[after] - self._stamps[before])
        return self._poses[before].interpolate(self._poses[after], fraction)

    def _extrapolate(self, stamp: float, limit_s: float) -> SE3 | None:
        """Carry the newest motion on to a stamp; None if that is too far ahead or nothing is known."""
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
