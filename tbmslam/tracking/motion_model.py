"""The prior on the robot's pose: its last pose and the motion by odometry since then, with their noise."""

import math
from typing import Literal

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.kernels.surfels.determined import determined_of_robot
from tbmslam.sensing.laser_scan import Reading
from tbmslam.tracking.odometry_noise import Deviations, OdometryNoise, OdometryNoiseConfig
from tbmslam.tracking.tracker import Coasting, PosePrior

_JUMP = 2.0
"""An odometry step is a jump if it exceeds the possible distance by more [m]."""
_OLD = 1.0
"""A motion between readings that lie further apart does not continue [s]."""
_TOO_OLD = 5.0
"""A robot that was not seen for longer may be anywhere: near its last pose its scan would fit by chance [s].
Without this limit gaps of 15 s in the scans of mit-csail tear one drive in twelve by 1 to 4 m."""
_LONGEST = 2.0
"""Largest ratio of an extrapolated step to the last step; stamps may be wrong."""
_FORGETTING = 0.05
"""Weight of the latest time between scans in the usual one."""
_NONE = 0.0, 0.0, 0.0
_SPEED = 1.0
"""Usual speed of robots, where the last motion is not known [m/s], [rad/s]."""
_TOP_SPEED = 15.0
"""No robot drives faster [m/s]."""


class MotionConfig(FrozenConfig):
    """Use and noise of the odometry between two scans."""

    composition: Literal["group", "component"] = Field(
        "group", description="'component' adds x, y and theta one by one as the original program does"
    )
    odometry: OdometryNoiseConfig = OdometryNoiseConfig()
    position_per_second: float = Field(0.5, gt=0, description="position deviation without odometry [m/s]")
    heading_per_second: float = Field(0.5, gt=0, description="heading deviation without odometry [rad/s]")


class MotionModel:
    """Predicts the robot's pose at the next reading.

    The odometry counts as one motion since the last keyframe, so its deviations do not depend on the rate of scans.
    """

    def __init__(self, config: MotionConfig) -> None:
        self._config = config
        self._stamp: float | None = None
        self._T_odom_robot: SE2 | None = None
        self._T_map_robot = SE2.identity()
        self._last_move = SE2.identity(), SE2.identity()
        self._duration = self._usual = 0.0  # the former is 0 unless the last motion may continue
        self._ahead, self._impossible = 0.0, 0
        self._step, self._jumped = (0.0, 0.0), False
        self._noise = OdometryNoise(config.odometry)
        # The odometry's frame at the last keyframe, and the odometry's distance and turn since then.
        self._T_map_odom = SE2.identity()
        self._distance, self._turn = 0.0, 0.0
        self._variances = _NONE  # of motions without odometry since the last keyframe
        self._of_keyframe: Deviations = _NONE  # variances of the last keyframe's pose in the local map

    def predict(self, reading: Reading) -> PosePrior:
        """Return the prior by odometry or, without odometry, by the motion between the last two readings.

        The first reading lies at its odometry pose, so the map's frame is the odometry's frame of that moment.
        """
        now, before = reading.T_odom_robot, self._T_odom_robot
        if self._stamp is None:
            start = now or SE2.identity()
            return PosePrior(start, _NONE, _NONE, start, _no_coasting)
        self._jumped = False
        if now is None or before is None:
            return self._by_constant_velocity(reading)
        stamp, step = reading.scan.stamp, before.to(now)
        length = math.hypot(step[0], step[1])
        self._step = length, _TOP_SPEED * abs(stamp - self._stamp)
        if not self._beyond() <= _JUMP:
            self._jumped = True
            return self._by_constant_velocity(reading)._replace(jump=length)
        motion = self._noise.deviations(self._distance + length, self._turn + abs(step[2]))
        if self._config.composition == "component":
            start = SE2(*(p + n - b for p, n, b in zip(self._T_map_robot, now, before, strict=True)))
            return PosePrior(start, motion, motion, start, _no_coasting, by_odometry=True)
        start, deviations = self._T_map_robot @ step, _with_variances(motion, self._of_keyframe)
        # Positional arguments, since names take half as long again.
        return PosePrior(
            self._T_map_odom @ now,
            deviations,
            motion,
            start,
            lambda: self.coasting(reading),
            0.0,
            True,
            self._swerve(start, stamp),
        )

    def coasting(self, reading: Reading) -> Coasting | None:
        """Return the robot's pose by its last motion, or by its last pose alone where that motion is not known.

        None if the last pose is too old.
        """
        since = 0.0 if self._stamp is None else reading.scan.stamp - self._stamp
        if since > _TOO_OLD:
            return None
        if self._duration and since <= _OLD:
            return Coasting(self._coasted(reading), self._coasting_deviations(reading))
        far = self._config.odometry.position_floor + _SPEED * max(since, self._usual)
        return Coasting(self._T_map_robot, (far, far, far))

    def motion_after(self, reading: Reading, duration: float) -> SE2:
        """Return the robot's motion in the time [s] after a reading that is not registered yet.

        It comes from the odometry at the scan's last beam if that is known, else from the odometry since the last
        reading. Without odometry it is the motion between the last two registered readings.
        """
        if duration <= 0.0:
            return SE2.identity()
        if reading.T_odom_robot is not None and reading.T_odom_swept is not None:
            return reading.T_odom_robot.to(reading.T_odom_swept)
        step, since = self._last_step(), self._duration
        if self._stamp is not None and reading.T_odom_robot is not None and self._T_odom_robot is not None:
            step, since = self._T_odom_robot.to(reading.T_odom_robot), reading.scan.stamp - self._stamp
        return _part(step, duration / since) if 0.0 < since <= _OLD else SE2.identity()

    def motion_to(self, reading: Reading, T_map_robot: SE2, duration: float) -> SE2:
        """Return the robot's motion in a time [s] at the speed at which it came from the last reading to a pose."""
        since = reading.scan.stamp - self._stamp if self._stamp is not None else 0.0
        step = self._T_map_robot.to(T_map_robot)
        return _part(step, duration / since) if 0.0 < since <= _OLD else SE2.identity()

    def correct(self, reading: Reading, T_map_robot: SE2, is_lost: bool = False) -> None:
        """Use the registered pose of a reading as the start of the next step.

        A lost scan contradicts its prior. Without odometry the prior is the last motion, which is then forgotten.
        Otherwise a robot whose scans do not fit circles for minutes (fr-clinic without odometry).
        """
        now, before = reading.T_odom_robot, self._T_odom_robot
        if self._stamp is None:
            self.begin_at_keyframe(reading, T_map_robot)
        else:
            duration = reading.scan.stamp - self._stamp
            self._usual += _FORGETTING * (min(abs(duration), 1.0) - self._usual)
            if duration > 0.0:
                start = T_map_robot if is_lost and now is None else self._T_map_robot
                self._last_move, self._duration = (start, T_map_robot), duration if duration <= _OLD else 0.0
            if now is None or before is None or self._jumped:
                steps = (
                    self._noise.deviations(self._distance, self._turn) if self._distance + self._turn else (0.0,) * 3
                )
                coasting = self._by_constant_velocity(reading).deviations
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
        self._stamp = reading.scan.stamp
        self._T_odom_robot = now
        self._T_map_robot = T_map_robot

    def learn(self, prior: PosePrior, T_map_robot: SE2, information: FloatArray | None, T_robot_sensor: SE2) -> None:
        """Learn the odometry's noise from the registered pose of a keyframe.

        `information` (3, 3) is that of the scan on the laser's pose in the map's frame; None if it is unknown.
        """
        if information is None:
            along, across, turn = prior.deviations
            self._of_keyframe = along * along, across * across, turn * turn
            return
        determined = determined_of_robot(information, prior.deviations, prior.mean.theta, (*T_robot_sensor,))
        if prior.by_odometry:
            self._noise.learn((*prior.mean.to(T_map_robot),), prior.deviations, prior.motion, determined)
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
        self._T_map_odom = T_map_robot @ (reading.T_odom_robot or SE2.identity()).inverse()
        self._distance, self._turn = 0.0, 0.0

    def _swerve(self, start: SE2, stamp: float) -> float:
        """Return the distance of a step to a pose from the robot's last motion at equal speed [m]."""
        if self._stamp is None or not self._duration:
            return 0.0
        ratio = min(max(stamp - self._stamp, 0.0) / self._duration, _LONGEST)
        # Along a line: the heading hardly changes within a step, and a constant twist takes ten times as long.
        (before_x, before_y, _), (x, y, _) = self._last_move
        return math.hypot(start[0] - x - ratio * (x - before_x), start[1] - y - ratio * (y - before_y))

    def _beyond(self) -> float:
        """Return the distance by which this step and the last steps exceed the possible distance [m].

        A leaky bucket: odometry in centimetres makes steps of metres, and only one of them may be a jump. The bucket
        leaks more slowly after impossible steps; otherwise such odometry would be trusted after each halt.
        """
        step, possible = self._step
        return self._ahead + step - possible / (1 + self._impossible)

    def _last_step(self) -> SE2:
        """Return the motion between the last two readings that were some time apart."""
        before, after = self._last_move
        return before.to(after)

    def _by_constant_velocity(self, reading: Reading) -> PosePrior:
        pose, deviations = self._coasted(reading), self._coasting_deviations(reading)
        return PosePrior(pose, deviations, deviations, pose, _no_coasting)

    def _coasted(self, reading: Reading) -> SE2:
        """Return the pose by the last motion, and the last pose where that motion is not known."""
        if self._stamp is None or not self._duration:
            return self._T_map_robot
        duration = min(max(reading.scan.stamp - self._stamp, 0.0), 1.0)
        return self._T_map_robot @ _part(self._last_step(), min(duration / self._duration, _LONGEST))

    def _coasting_deviations(self, reading: Reading) -> Deviations:
        config = self._config
        # Stamps may be anything: a scan soon after another one by its stamp may have been taken as late as usual.
        duration = max(0.0 if self._stamp is None else min(reading.scan.stamp - self._stamp, 1.0), self._usual)
        position = config.odometry.position_floor + config.position_per_second * duration
        return position, position, config.odometry.heading_floor + config.heading_per_second * duration


def _no_coasting() -> None:
    """Return no pose, since the prior itself comes from the last motion."""
    return


def _with_variances(motion: Deviations, more: Deviations) -> Deviations:
    """Return the deviations of a motion with more variances."""
    (along, across, turn), (a, b, c) = motion, more
    return math.sqrt(along * along + a), math.sqrt(across * across + b), math.sqrt(turn * turn + c)


def _part(motion: SE2, ratio: float) -> SE2:
    """Return a motion at constant twist over `ratio` times its duration."""
    vx, vy, omega = motion.log()
    return SE2.exp(ratio * vx, ratio * vy, ratio * omega)
