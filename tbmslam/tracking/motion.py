"""Where the robot probably is now: its last pose, moved as the wheels say, and how far that can be wrong."""

import math
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.laser_scan import Reading
from tbmslam.se2 import SE2, FloatArray, wrap_angle
from tbmslam.tracking.odometry_doubt import OdometryDoubt, OdometryDoubtConfig

_STANDING = 0.001  # what wheels that stand still may seem to move from scan to scan [m, rad]


class MotionConfig(FrozenConfig):
    """How odometry is used and how far it is trusted between two scans."""

    composition: Literal["group", "component"] = Field(
        "group", description="'component' adds x, y and theta one by one as the original program does"
    )
    position_floor: float = Field(0.01, gt=0, description="position uncertainty of any step [m]")
    position_per_metre: float = Field(0.1, ge=0, description="more of it per travelled metre [m/m]")
    position_per_radian: float = Field(0.05, ge=0, description="more of it per turned radian [m/rad]")
    heading_floor: float = Field(0.005, gt=0, description="heading uncertainty of any step [rad]")
    heading_per_metre: float = Field(0.05, ge=0, description="more of it per travelled metre [rad/m]")
    heading_per_radian: float = Field(0.1, ge=0, description="more of it per turned radian [rad/rad]")
    position_per_second: float = Field(0.5, gt=0, description="position uncertainty without odometry [m/s]")
    heading_per_second: float = Field(0.5, gt=0, description="heading uncertainty without odometry [rad/s]")
    persistence: float = Field(0.5, gt=0, description="how long a motion goes on and can contradict the odometry [s]")
    frozen: float = Field(
        0.4, gt=0, description="odometry that stands still is not believed once the scans have moved so far [m, rad]"
    )
    jump: float = Field(2.0, gt=0, description="a step of the odometry beyond this is not believed [m]")
    jump_per_second: float = Field(15.0, gt=0, description="nor what goes on faster than this, added to it [m/s]")
    doubt: OdometryDoubtConfig = OdometryDoubtConfig()


class Prediction(NamedTuple):
    """Where the robot should be.

    Parameters
    ----------
    T_map_robot
        The pose.
    deviations
        Standard deviations (3,) of x, y [m] and theta [rad] that the last step adds.
    jump
        How far the odometry stepped where that is impossible, so that it was left out [m]; else 0.
    is_frozen
        Whether the odometry stands still while the robot moves, so that it was left out.
    by_odometry
        Whether the pose is the odometry's.
    """

    T_map_robot: SE2
    deviations: FloatArray
    jump: float = 0.0
    is_frozen: bool = False
    by_odometry: bool = False


class MotionModel:
    """Carries the pose from one reading to the next."""

    def __init__(self, config: MotionConfig) -> None:
        self._config = config
        self._stamp: float | None = None
        self._T_odom_robot: SE2 | None = None
        self._T_map_robot = SE2.identity()
        self._last_move = SE2.identity(), SE2.identity()
        self._duration = 0.0
        self._T_map_stopped = SE2.identity()  # where the robot was when its odometry last moved
        self._ahead, self._impossible = 0.0, 0
        self._doubt = OdometryDoubt(config.doubt)

    def predict(self, reading: Reading) -> Prediction:
        """Return where the robot is by odometry or, without any, by the motion between its last two readings.

        The first reading lies at its odometry pose, so the map's frame is the odometry's frame of that moment.
        """
        if self._stamp is None:
            start = reading.T_odom_robot or SE2.identity()
            return Prediction(start, np.zeros(3))
        if reading.T_odom_robot is not None and self._T_odom_robot is not None:
            before, now = self._T_odom_robot, reading.T_odom_robot
            if not self._beyond(reading) <= self._config.jump:
                return self._by_constant_velocity(reading)._replace(jump=self._odometry_step(reading)[0])
            if self._is_frozen(before, now):
                return self._by_constant_velocity(reading)._replace(is_frozen=True)
            return self.by_odometry(before, now, self._T_map_robot)
        return self._by_constant_velocity(reading)

    def coasting(self, reading: Reading) -> SE2:
        """Return where the robot would be if it just went on as before."""
        if self._stamp is None or not 0.0 < self._duration <= 1.0:
            return self._T_map_robot
        duration = min(max(reading.scan.stamp - self._stamp, 0.0), 1.0)
        return self._T_map_robot @ _part(self._last_step(), duration / self._duration)

    def alternative(self, reading: Reading, T_map_robot: SE2) -> SE2:
        """Return another guess than the odometry's T_map_robot, should that be wrong: where coasting has led.

        A robot goes on as before for a moment only. After a longer time its last motion says less than any odometry,
        whose guess then comes back: in a crossing, that of a turn not taken fits as well as that of the turn.
        """
        if self._stamp is None or reading.scan.stamp - self._stamp > self._config.persistence:
            return T_map_robot
        return self.coasting(reading)

    def motion_after(self, reading: Reading, duration: float) -> SE2:
        """Return how the robot moves in the time [s] after a reading that is about to be placed.

        As the odometry goes on to the scan's last beam where that is known; else as it came since the last reading;
        without odometry as the robot was found to move between its last two readings.
        """
        if duration <= 0.0:
            return SE2.identity()
        if reading.T_odom_robot is not None and reading.T_odom_swept is not None:
            return reading.T_odom_robot.to(reading.T_odom_swept)
        step, since = self._last_step(), self._duration
        if self._stamp is not None and reading.T_odom_robot is not None and self._T_odom_robot is not None:
            step, since = self._T_odom_robot.to(reading.T_odom_robot), reading.scan.stamp - self._stamp
        return _part(step, duration / since) if 0.0 < since <= 1.0 else SE2.identity()

    def motion_to(self, reading: Reading, T_map_robot: SE2, duration: float) -> SE2:
        """Return how the robot moves in some time [s] if since the last reading it has come to a pose."""
        since = reading.scan.stamp - self._stamp if self._stamp is not None else 0.0
        step = self._T_map_robot.to(T_map_robot)
        return _part(step, duration / since) if 0.0 < since <= 1.0 else SE2.identity()

    def correct(self, reading: Reading, T_map_robot: SE2) -> None:
        """Take the pose that was found for a reading as the start of the next step."""
        if self._stamp is not None:
            duration = reading.scan.stamp - self._stamp
            if duration > 0.0:
                self._last_move, self._duration = (self._T_map_robot, T_map_robot), duration
        if not _is_still(self._T_odom_robot, reading.T_odom_robot):
            self._T_map_stopped = T_map_robot
        beyond = self._beyond(reading)
        if beyond <= self._config.jump:  # what was not believed is not held against what comes next
            self._ahead = max(beyond, 0.0)
        step, possible = self._odometry_step(reading)
        self._impossible = self._impossible + 1 if step > possible else max(self._impossible - 1, 0)
        self._stamp = reading.scan.stamp
        self._T_odom_robot = reading.T_odom_robot
        self._T_map_robot = T_map_robot

    def learn(self, prediction: Prediction, guess: SE2, pose: SE2, information: FloatArray | None) -> None:
        """Learn how good the odometry is from where a scan was found.

        Parameters
        ----------
        prediction
            Where the robot was thought to be.
        guess, pose
            Pose of the laser then, and as found.
        information
            What the scan tells of the pose (3, 3); None where it does not say.
        """
        if prediction.by_odometry and information is not None:
            self._doubt.note(guess, pose, prediction.deviations, information)

    def _beyond(self, reading: Reading) -> float:
        """Return how far the odometry came beyond what any robot's speed explains, lately and with this step [m].

        A leaky bucket: lengths in centimetres make steps of metres, each of which might be a jump, but not all of them.
        It leaks the slower, the more often steps were impossible lately, or each halt would give such lengths a chance.
        """
        step, possible = self._odometry_step(reading)
        return self._ahead + step - possible / (1 + self._impossible)

    def _odometry_step(self, reading: Reading) -> tuple[float, float]:
        """Return how far the odometry came since the last reading, and how far any robot comes [m]."""
        before, now = self._T_odom_robot, reading.T_odom_robot
        if self._stamp is None or before is None or now is None:
            return 0.0, 0.0
        since = abs(reading.scan.stamp - self._stamp)
        return math.hypot(now.x - before.x, now.y - before.y), self._config.jump_per_second * since

    def _is_frozen(self, T_odom_before: SE2, T_odom_now: SE2) -> bool:
        """Tell whether the odometry stands still although the scans went on, as when its driver or a cable fails."""
        if not _is_still(T_odom_before, T_odom_now):
            return False
        moved = self._T_map_stopped.to(self._T_map_robot)
        return max(math.hypot(moved.x, moved.y), abs(moved.theta)) > self._config.frozen

    def _last_step(self) -> SE2:
        """Return the motion between the last two readings that were some time apart."""
        before, after = self._last_move
        return before.to(after)

    def by_odometry(self, T_odom_before: SE2, T_odom_now: SE2, T_map_before: SE2) -> Prediction:
        """Return where the robot is by its odometry since it was at a pose."""
        config = self._config
        step = T_odom_before.to(T_odom_now)
        if config.composition == "component":
            pose = SE2(*(p + n - b for p, n, b in zip(T_map_before, T_odom_now, T_odom_before, strict=True)))
        else:
            pose = T_map_before @ step
        distance, turn = math.hypot(step.x, step.y), abs(step.theta)
        position = config.position_floor + config.position_per_metre * distance + config.position_per_radian * turn
        heading = config.heading_floor + config.heading_per_metre * distance + config.heading_per_radian * turn
        position, heading = position * self._doubt.of_position, heading * self._doubt.of_heading
        return Prediction(pose, np.array((position, position, heading)), by_odometry=True)

    def _by_constant_velocity(self, reading: Reading) -> Prediction:
        config = self._config
        duration = 0.0 if self._stamp is None else min(max(reading.scan.stamp - self._stamp, 0.0), 1.0)
        position = config.position_floor + config.position_per_second * duration
        heading = config.heading_floor + config.heading_per_second * duration
        return Prediction(self.coasting(reading), np.array([position, position, heading]))


def _is_still(T_odom_before: SE2 | None, T_odom_now: SE2 | None) -> bool:
    """Tell whether two poses of the odometry are the same but for noise of a standing robot."""
    if T_odom_before is None or T_odom_now is None:
        return False
    moved = math.hypot(T_odom_now.x - T_odom_before.x, T_odom_now.y - T_odom_before.y)
    return moved < _STANDING and abs(wrap_angle(T_odom_now.theta - T_odom_before.theta)) < _STANDING


def _part(motion: SE2, ratio: float) -> SE2:
    """Return a motion at constant twist over `ratio` times its duration."""
    vx, vy, omega = motion.log()
    return SE2.exp(ratio * vx, ratio * vy, ratio * omega)
