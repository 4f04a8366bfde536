"""Whether the odometry goes where the scans say: wheels slip, counters jump, drivers freeze."""

import math
from collections import deque

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2

_SHORTEST_S = 0.02  # stamps may be anything
_USUAL_STEPS = 20
_FORGETTING = 0.995  # of the top speed, from reading to reading


class OdometryCheckConfig(FrozenConfig):
    """When odometry and scans contradict each other."""

    keyframes: int = Field(4, ge=1, description="number of steps over which motions are compared")
    distance: float = Field(0.4, gt=0, description="difference that is worth a warning [m]")
    angle: float = Field(0.4, gt=0, description="difference that is worth a warning [rad]")
    per_metre: float = Field(0.25, ge=0, description="more of both per travelled metre")
    scale: float = Field(0.06, gt=0, description="share by which lengths differ all along that is worth a warning")
    lengths: int = Field(10, ge=1, description="lengths that must be compared for that, of a metre at least")
    step: float = Field(0.3, gt=0, description="length from which on a single step may be a jump [m]")
    speeding: float = Field(4.0, gt=1, description="times the usual top speed that make it one")


class OdometryCheck:
    """Compares the odometry's motion with the scans', from keyframe to keyframe, and with what is usual."""

    def __init__(self, config: OdometryCheckConfig) -> None:
        self._config = config
        self._known: deque[tuple[SE2, SE2]] = deque(maxlen=config.keyframes + 1)
        self._last: tuple[float, SE2] | None = None
        self._steps = 0
        self._top_speed = 0.0

    def jumps(self, stamp: float, T_odom_robot: SE2 | None) -> bool:
        """Tell whether the last step of the odometry was much faster than usual."""
        last, self._last = self._last, None if T_odom_robot is None else (stamp, T_odom_robot)
        if last is None or T_odom_robot is None:
            return False
        before, (x, y, _) = last
        distance = math.hypot(T_odom_robot[0] - x, T_odom_robot[1] - y)
        speed = distance / max(stamp - before, _SHORTEST_S)
        if distance > self._config.step and speed > self._config.speeding * self._top_speed:
            usual = self._steps >= _USUAL_STEPS and self._top_speed > 0.0
            if usual:
                return True
        self._steps += 1
        self._top_speed = max(speed, _FORGETTING * self._top_speed)
        return False

    def disagrees(self, T_odom_robot: SE2 | None, T_map_robot: SE2) -> bool:
        """Tell whether the motions since the first keyframe that is remembered differ by too much."""
        if T_odom_robot is None:
            self._known.clear()
            return False
        self._known.append((T_odom_robot, T_map_robot))
        T_odom_first, T_map_first = self._known[0]
        by_wheels, by_scans = T_odom_first.to(T_odom_robot), T_map_first.to(T_map_robot)
        apart = by_wheels.to(by_scans)
        config = self._config
        more = config.per_metre * math.hypot(by_scans.x, by_scans.y)
        distance = math.hypot(apart.x, apart.y)
        angle = abs(math.remainder(apart.theta, 2.0 * math.pi))
        if distance <= config.distance + more and angle <= config.angle + more:
            return False
        self._known.clear()
        return True
