"""The time by which the odometry at a scan is older than the scan, estimated from the registration of scans.

Odometry and scans have clocks, buffers and filters of their own. If the odometry is too old by t, it lacks
the rotation t (w_2 - w_1) between turning speeds w_1 and w_2. The correction of the heading at a keyframe measures it,
and t is the state of a Kalman filter without process noise (J. Kelly and G. Sukhatme, "A general framework for
temporal calibration of multiple proprioceptive and exteroceptive sensors", ISER 2010, align headings as well).
"""

import math

from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.sensing.laser_scan import Reading
from tbmslam.tracking.student_t import FREEDOM

_USUAL = 0.05
"""Standard deviation of the lags of robots [s]; those of four real drives are -0.14 to 0.04 s."""
_MOST = 0.3
"""Larger lags are faults of the odometry [s]."""
_LONGEST_S = 0.3
"""A speed is known from two poses at most this far apart. With 0.5 s, drives of mit-csail with a scan each metre or 0.5
rad err more, since the robot's speed changes in between."""
_LEAST_S, _SHORTEST = 1e-3, 0.5
"""A speed is unknown from two poses that lie closer than this time [s], or than this share of the time between the two
readings before: stamps may jitter."""
_LEAST_SHARE = 1e-3
"""Where a scan determines less of the heading, nothing is learnt."""
_FASTEST, _FASTEST_TURN = 5.0, 3.0
"""Faster motions are jumps of the odometry [m/s], [rad/s]."""


class OdometryLag:
    """Estimates the lag, and moves the odometry by it; with `is_learnt` false the odometry stays as it is."""

    def __init__(self, is_learnt: bool = True) -> None:
        self.value = 0.0
        """The lag [s]; positive if the odometry is too old."""
        self._is_learnt = is_learnt
        self._variance = _USUAL**2
        self._reading: Reading | None = None
        self._pose: SE2 | None = None
        self._duration = 0.0  # between the last two readings
        self._has_speed = False  # whether the speed at the last reading is known
        self._T_sync_odom = SE2.identity()  # changes with the former, so that no pose jumps then
        self._rate = self._rate_at_keyframe = math.nan  # turning at the last reading and keyframe, nan if unknown

    def pose_at(self, reading: Reading) -> SE2 | None:
        """Return the odometry's pose at the time of the scan; readings come in their order.

        The frame of the result is arbitrary: only motions between poses count. A motion between two readings is
        corrected if both speeds are known.
        """
        if not self._is_learnt:
            return reading.T_odom_robot
        if reading is not self._reading:
            before, self._reading = self._reading, reading
            self._pose = self._next(before, reading)
        return self._pose

    def begin_at_keyframe(self) -> None:
        """Begin a motion at the last reading."""
        self._rate_at_keyframe = self._rate

    def learn(self, turn: float, deviation: float, share: float) -> None:
        """Learn from the correction of the heading at a keyframe [rad], just before `begin_at_keyframe`.

        `deviation` is that of the prior heading [rad], and `share` the part that the scan determined, in [0, 1].
        """
        slope = share * (self._rate - self._rate_at_keyframe)
        if not self._is_learnt or math.isnan(slope) or share < _LEAST_SHARE:
            return
        # Student's t distribution: slipping wheels are outliers.
        # A correction is the determined share of an innovation of variance deviation^2 / share.
        variance = share * deviation * deviation
        variance *= (FREEDOM + turn * turn / variance) / (FREEDOM + 1.0)
        gain = self._variance * slope / (slope * slope * self._variance + variance)
        self.value = min(max(self.value + gain * turn, -_MOST), _MOST)
        self._variance *= 1.0 - gain * slope

    def _next(self, before: Reading | None, reading: Reading) -> SE2 | None:
        """Return the pose of the reading after the last one."""
        now, last, pose = reading.T_odom_robot, None if before is None else before.T_odom_robot, self._pose
        self._rate = math.nan
        if now is None:
            return None
        if before is None or last is None or pose is None:
            self._has_speed = False
            return self._T_sync_odom @ now
        moved = self._moved(last, now, reading.scan.stamp - before.scan.stamp)
        if (moved is not None) != self._has_speed:
            # The step stays as the odometry reports it.
            self._T_sync_odom = pose @ last.inverse() if moved is None else pose @ last.to(now) @ moved.inverse()
            self._has_speed = moved is not None
        return self._T_sync_odom @ (now if moved is None else moved)

    def _moved(self, last: SE2, now: SE2, duration: float) -> SE2 | None:
        """Return the pose after the lag at the speed of the last motion, along an arc; None if that is unknown."""
        turn, x, y = wrap_angle(now.theta - last.theta), now.x - last.x, now.y - last.y
        before, self._duration = self._duration, duration
        if not max(_SHORTEST * before, _LEAST_S) <= duration <= _LONGEST_S or abs(turn) > _FASTEST_TURN * duration:
            return None
        if math.hypot(x, y) > _FASTEST * duration:
            return None
        self._rate, ratio = turn / duration, self.value / duration
        bend = 0.5 * (1.0 + ratio) * turn  # a chord has the heading of the middle of its arc
        cosine, sine = ratio * math.cos(bend), ratio * math.sin(bend)
        return SE2(now.x + cosine * x - sine * y, now.y + sine * x + cosine * y, now.theta + ratio * turn)
