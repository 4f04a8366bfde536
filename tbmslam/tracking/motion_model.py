"""The prior on the robot's pose: its last pose and the motion by odometry since then, with their noise."""

import math

from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.kernels.surfels.determined import determined_of_robot
from tbmslam.sensing.laser_scan import Reading
from tbmslam.tracking.constant_velocity import OLD, ConstantVelocity, part_of
from tbmslam.tracking.motion_config import MotionConfig
from tbmslam.tracking.odometry_lag import OdometryLag
from tbmslam.tracking.odometry_noise import Deviations, OdometryNoise
from tbmslam.tracking.tracker import PosePrior

_JUMP = 2.0
"""An odometry step is a jump if it exceeds the possible distance by more [m]."""
_NONE = 0.0, 0.0, 0.0
_TOP_SPEED = 15.0
"""No robot drives faster [m/s]."""
_ORIGIN = 0.1
"""Odometry that is so near its origin again may have begun anew [m], [rad]. Without this limit, gaps of 15 s in the
scans of mit-csail tear the drive, for an unexplored place fits worse than the last place by chance."""


class MotionModel:
    """Predicts the robot's pose at the next reading.

    The odometry counts as one motion since the last keyframe, so its deviations do not depend on the rate of scans.
    """

    def __init__(self, config: MotionConfig) -> None:
        self._config = config
        self._inertia = ConstantVelocity(config)
        self._T_odom_robot: SE2 | None = None
        self._ahead, self._impossible = 0.0, 0
        self._step, self._jumped = (0.0, 0.0), False
        self._stood = False  # whether the robot may have stood while the odometry began anew
        self._noise, self._lag = OdometryNoise(config.odometry), OdometryLag(config.odometry.learning)
        # The odometry's frame at the last keyframe, and the odometry's distance and turn since then.
        self._T_map_odom = SE2.identity()
        self._distance, self._turn = 0.0, 0.0
        self._variances = _NONE  # of motions without odometry since the last keyframe
        self._of_keyframe: Deviations = _NONE  # variances of the last keyframe's pose in the local map

    def predict(self, reading: Reading) -> PosePrior:
        """Return the prior by odometry or, without odometry, by the motion between the last two readings.

        The first reading lies at its odometry pose, so the map's frame is the odometry's frame of that moment.
        """
        now, before = self._lag.pose_at(reading), self._T_odom_robot
        inertia = self._inertia
        if inertia.stamp is None:
            start = now or SE2.identity()
            return PosePrior(start, _NONE, _NONE, start, _no_coasting)
        self._jumped = self._stood = False
        if now is None or before is None:
            return self._by_constant_velocity(reading.scan.stamp)
        stamp, step = reading.scan.stamp, before.to(now)
        length = math.hypot(step[0], step[1])
        self._step = length, _TOP_SPEED * abs(stamp - inertia.stamp)
        if not self._beyond() <= _JUMP:
            self._jumped = True
            return self._by_constant_velocity(stamp)._replace(jump=length)
        motion = self._noise.deviations(self._distance + length, self._turn + abs(step[2]))
        if self._config.composition == "component":
            start = SE2(*(p + n - b for p, n, b in zip(inertia.T_map_robot, now, before, strict=True)))
            return PosePrior(start, motion, motion, start, _no_coasting, by_odometry=True)
        start, deviations = inertia.T_map_robot @ step, _with_variances(motion, self._of_keyframe)
        stood = inertia.standing(stamp) if length > _JUMP and _is_at_origin(reading) else None
        self._stood = stood is not None
        # Positional arguments, since names take half as long again.
        return PosePrior(
            self._T_map_odom @ now,
            deviations,
            motion,
            start,
            lambda: inertia.coasting(stamp),
            0.0,
            True,
            inertia.swerve(start, stamp),
            stood,
        )

    @property
    def began_anew(self) -> bool:
        """Whether the odometry began anew in a pause before the last reading, by the pose of its scan."""
        return self._stood and self._jumped

    def motion_after(self, reading: Reading, duration: float) -> SE2:
        """Return the robot's motion in the time [s] after a reading that is not registered yet.

        It comes from the odometry at the scan's last beam if that is known, else from the odometry since the last
        reading. Without odometry it is the motion between the last two registered readings.
        """
        if duration <= 0.0:
            return SE2.identity()
        if reading.T_odom_robot is not None and reading.T_odom_swept is not None:
            return reading.T_odom_robot.to(reading.T_odom_swept)
        now, before = self._lag.pose_at(reading), self._T_odom_robot
        if self._inertia.stamp is None or now is None or before is None:
            return self._inertia.motion(duration)
        step, since = before.to(now), self._inertia.since(reading.scan.stamp)
        return part_of(step, duration / since) if 0.0 < since <= OLD else SE2.identity()

    def motion_to(self, reading: Reading, T_map_robot: SE2, duration: float) -> SE2:
        """Return the robot's motion in a time [s] at the speed at which it came from the last reading to a pose."""
        return self._inertia.motion_to(reading.scan.stamp, T_map_robot, duration)

    def correct(self, reading: Reading, T_map_robot: SE2, is_lost: bool = False) -> None:
        """Use the registered pose of a reading as the start of the next step.

        A lost scan contradicts its prior. Without odometry the prior is the last motion, which is then forgotten.
        Otherwise a robot drives in circles for minutes if its scans do not fit (fr-clinic without odometry).
        """
        now, before = self._lag.pose_at(reading), self._T_odom_robot
        if self._stood and now is not None:
            by_odometry, before_pause = self._T_map_odom @ now, self._inertia.T_map_robot
            self._jumped = _distance(T_map_robot, before_pause) < _distance(T_map_robot, by_odometry)
        if self._inertia.stamp is None:
            self.begin_at_keyframe(reading, T_map_robot)
        else:
            if now is None or before is None or self._jumped:
                steps = (
                    self._noise.deviations(self._distance, self._turn) if self._distance + self._turn else (0.0,) * 3
                )
                coasting = self._inertia.deviations(reading.scan.stamp)
                along, across, heading = (
                    v + s * s + c * c for v, s, c in zip(self._variances, steps, coasting, strict=True)
                )
                self._variances = along, across, heading
                self._begin(reading, T_map_robot)
                if not self._jumped:
                    self._step = 0.0, 0.0
            else:
                self._distance += self._step[0]
                self._turn += abs(wrap_angle(now[2] - before[2]))
                self._ahead = max(self._beyond(), 0.0)
            step, possible = self._step
            if step > possible:
                self._impossible += 1
            elif self._impossible:
                self._impossible -= 1
        self._inertia.follow(reading.scan.stamp, T_map_robot, stops=is_lost and now is None)
        self._T_odom_robot = now

    def learn(self, prior: PosePrior, T_map_robot: SE2, information: FloatArray | None, T_robot_sensor: SE2) -> None:
        """Learn noise and lag of the odometry, or the noise of turning without it, from the pose of a keyframe.

        `information` (3, 3) is that of the scan on the laser's pose in the map's frame; None if it is unknown.
        """
        if information is None:
            along, across, turn = prior.deviations
            self._of_keyframe = along * along, across * across, turn * turn
            return
        determined = determined_of_robot(information, prior.deviations, prior.mean.theta, (*T_robot_sensor,))
        error = prior.mean.to(T_map_robot)
        if prior.by_odometry:
            if not self.began_anew:  # else the error is no noise
                self._lag.learn(error.theta, prior.deviations[2], determined[2])
                self._noise.learn((*error,), prior.deviations, prior.motion, determined)
        else:
            self._inertia.learn(error.theta, prior.deviations[2], determined[2])
        (along, across, turn), (a, b, c) = determined, prior.deviations
        self._of_keyframe = (1.0 - along) * a * a, (1.0 - across) * b * b, (1.0 - turn) * c * c

    def begin_at_keyframe(self, reading: Reading, T_map_robot: SE2) -> None:
        """Begin the odometry's motion at a keyframe."""
        self._begin(reading, T_map_robot)
        self._variances = _NONE

    def deviations_since_keyframe(self, prior: PosePrior) -> Deviations:
        """Return the deviations of the motion from the last keyframe to the last reading's prior."""
        # Without odometry, `correct` has already added those of the prior.
        return _with_variances(prior.motion if prior.by_odometry else _NONE, self._variances)

    def _begin(self, reading: Reading, T_map_robot: SE2) -> None:
        self._T_map_odom = T_map_robot @ (self._lag.pose_at(reading) or SE2.identity()).inverse()
        self._lag.begin_at_keyframe()
        self._distance, self._turn = 0.0, 0.0

    def _beyond(self) -> float:
        """Return the distance by which this step and the last steps exceed the possible distance [m].

        A leaky bucket: odometry in centimetres makes steps of metres, and only one of them may be a jump. The bucket
        leaks more slowly after impossible steps; otherwise such odometry would be trusted after each halt.
        """
        step, possible = self._step
        return self._ahead + step - possible / (1 + self._impossible)

    def _by_constant_velocity(self, stamp: float) -> PosePrior:
        pose, deviations = self._inertia.pose(stamp), self._inertia.deviations(stamp)
        return PosePrior(pose, deviations, deviations, pose, _no_coasting)


def _no_coasting() -> None:
    """Return no pose: the prior is the first one, comes from the last motion, or is composed by components."""
    return


def _is_at_origin(reading: Reading) -> bool:
    """Return whether the odometry is near the pose at which it began."""
    robot = reading.T_odom_robot
    return robot is not None and max(map(abs, reading.T_odom_origin.to(robot))) < _ORIGIN


def _distance(one: SE2, other: SE2) -> float:
    """Return the distance of two poses [m]."""
    return math.hypot(other[0] - one[0], other[1] - one[1])


def _with_variances(motion: Deviations, more: Deviations) -> Deviations:
    """Return the deviations of a motion with more variances."""
    (along, across, turn), (a, b, c) = motion, more
    return math.sqrt(along * along + a), math.sqrt(across * across + b), math.sqrt(turn * turn + c)
