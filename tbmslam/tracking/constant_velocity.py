"""The motion of a robot that keeps its speed: the prior without odometry, and a check of the odometry."""

import math

from tbmslam.geometry.se2 import SE2
from tbmslam.tracking.motion_config import MotionConfig
from tbmslam.tracking.noise_factor import NoiseFactor
from tbmslam.tracking.odometry_noise import Deviations
from tbmslam.tracking.student_t import student_weight
from tbmslam.tracking.tracker import Coasting

OLD = 1.0
"""A motion between readings that lie further apart does not continue [s]."""
_TOO_OLD = 5.0
"""A robot that was not seen for longer may be anywhere: near its last pose its scan would fit by chance [s].
Without this limit gaps of 15 s in the scans of mit-csail tear one drive in twelve by 1 to 4 m."""
_LONGEST = 2.0
"""Largest ratio of an extrapolated step to the last step; stamps may be wrong."""
_FORGETTING = 0.05
"""Weight of the latest time between scans in the usual one."""
_SPEED = 1.0
"""Usual speed of robots, where the last motion is not known [m/s], [rad/s]."""


class ConstantVelocity:
    """Predicts a pose from the motion between the last two poses.

    It learns the noise of the turning speed. It does not learn the noise of the speed: in a corridor no scan determines
    it, so the prediction would confirm itself (aces without odometry: errors of 0.03 to 0.7 m).
    """

    def __init__(self, config: MotionConfig) -> None:
        self._position = config.odometry.position_floor, config.position_per_second
        self._heading = config.odometry.heading_floor, config.heading_per_second
        self._learning = config.odometry.learning
        self._turning = NoiseFactor(config.odometry.memory, config.odometry.certainty)
        self.stamp: float | None = None
        """Stamp of the last pose [s]."""
        self.T_map_robot = SE2.identity()
        """The last pose."""
        self._last_move = SE2.identity(), SE2.identity()
        self._duration = self._usual = 0.0  # the former is 0 unless the last motion may continue

    def since(self, stamp: float) -> float:
        """Return the time since the last pose [s]."""
        return 0.0 if self.stamp is None else stamp - self.stamp

    def pose(self, stamp: float) -> SE2:
        """Return the pose by the last motion, and the last pose where that motion is not known."""
        if self.stamp is None or not self._duration:
            return self.T_map_robot
        duration = min(max(stamp - self.stamp, 0.0), 1.0)
        return self.T_map_robot @ part_of(self._last_step(), min(duration / self._duration, _LONGEST))

    def deviations(self, stamp: float) -> Deviations:
        """Return the deviations of `pose`."""
        # Stamps may be anything: a scan soon after another one by its stamp may have been taken as late as usual.
        duration = max(min(self.since(stamp), 1.0), self._usual)
        (floor, per_second), (heading_floor, heading_per_second) = self._position, self._heading
        position, heading = floor + per_second * duration, heading_floor + heading_per_second * duration
        # The learnt factor also applies after gaps and lost scans: aces and fr-clinic err no more.
        return position, position, heading * self._turning.value

    def coasting(self, stamp: float) -> Coasting | None:
        """Return `pose` with its deviations, or the last pose with wide ones where the last motion is not known.

        None if the last pose is too old.
        """
        since = self.since(stamp)
        if since > _TOO_OLD:
            return None
        if self._duration and since <= OLD:
            return Coasting(self.pose(stamp), self.deviations(stamp))
        far = self._position[0] + _SPEED * max(since, self._usual)
        return Coasting(self.T_map_robot, (far, far, far))

    def standing(self, stamp: float) -> Coasting | None:
        """Return the last pose, with the deviations of a motion that began lately; None without a pause before."""
        return Coasting(self.T_map_robot, self.deviations(stamp)) if self.since(stamp) > OLD else None

    def motion(self, duration: float) -> SE2:
        """Return the motion in a time [s] at the speed of the last motion."""
        return part_of(self._last_step(), duration / self._duration) if self._duration else SE2.identity()

    def motion_to(self, stamp: float, T_map_robot: SE2, duration: float) -> SE2:
        """Return the motion in a time [s] at the speed at which the robot came from the last pose to this one."""
        since = self.since(stamp)
        return part_of(self.T_map_robot.to(T_map_robot), duration / since) if 0.0 < since <= OLD else SE2.identity()

    def swerve(self, pose: SE2, stamp: float) -> float:
        """Return the distance of a step to a pose from the robot's last motion at equal speed [m]."""
        if self.stamp is None or not self._duration:
            return 0.0
        ratio = min(max(stamp - self.stamp, 0.0) / self._duration, _LONGEST)
        # Along a line: the heading hardly changes within a step, and a constant twist takes ten times as long.
        (before_x, before_y, _), (after_x, after_y, _) = self._last_move
        x, y, _ = self.T_map_robot
        return math.hypot(pose[0] - x - ratio * (after_x - before_x), pose[1] - y - ratio * (after_y - before_y))

    def follow(self, stamp: float, T_map_robot: SE2, stops: bool) -> None:
        """Take a pose as the last one; `stops` forgets the motion to it."""
        if self.stamp is not None:
            duration = stamp - self.stamp
            self._usual += _FORGETTING * (min(abs(duration), 1.0) - self._usual)
            if duration > 0.0:
                start = T_map_robot if stops else self.T_map_robot
                self._last_move, self._duration = (start, T_map_robot), duration if duration <= OLD else 0.0
        self.stamp, self.T_map_robot = stamp, T_map_robot

    def learn(self, turn: float, deviation: float, share: float) -> None:
        """Learn from a correction of the heading [rad], with the deviation of the prior and the determined share."""
        if self._learning:
            weight = student_weight((turn / deviation) ** 2, 1)
            self._turning.learn(weight, turn, deviation, deviation, share)

    def _last_step(self) -> SE2:
        """Return the motion between the last two readings that were some time apart."""
        before, after = self._last_move
        return before.to(after)


def part_of(motion: SE2, ratio: float) -> SE2:
    """Return a motion at constant twist over `ratio` times its duration."""
    vx, vy, omega = motion.log()
    return SE2.exp(ratio * vx, ratio * vy, ratio * omega)
