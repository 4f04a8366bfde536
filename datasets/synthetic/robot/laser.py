"""A simulated laser range finder: exact geometry with the errors of real lasers."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from datasets.synthetic.world.world import World
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.rays.ray_casting import cast_rays
from tbmslam.sensing.laser_scan import LaserScan

_BEAMS_OVER_180_DEG = {180: 1.0, 181: 1.0, 361: 0.5}
"""Usual SICK scanners: beams and their step [deg]."""


_MOMENT = 5e-4  # the robot's motion in this time is negligible [s]

_MOST_RATE, _FARTHEST_MOUNT = 10_000.0, 100.0

STATA_MOUNT = SE2(0.275, 0.0, 0.0)
"""Mount of the base laser of a PR2."""


@dataclass(frozen=True)
class SimulatedLaser:
    """Properties of a laser; the default is the base laser of MIT's PR2 at the Stata Center."""

    beams: int = 1040
    angle_min: float = -2.26892805
    angle_increment: float = 0.00436332
    """Directions of the beams in the sensor's own frame [rad]."""
    rate: float = 20.0
    """Rate of the scans [Hz]."""
    range_min: float = 0.023
    range_max: float = 30.0
    """Shortest and longest range [m]."""
    noise: float = 0.01
    """Standard deviation of a range [m]."""
    dropouts: float = 0.003
    """Share of the beams without return despite a wall."""
    wrong_returns: float = 0.001
    """Share of the beams that end at random before the wall."""
    T_robot_sensor: SE2 = STATA_MOUNT
    upside_down: bool = False
    """Whether it is upside down, so that its beams are in clockwise order seen from above."""
    sweep: float = 0.0
    """Time from the first beam to the last [s]; 0 if all are simultaneous."""

    def __post_init__(self) -> None:
        """Check every value."""
        for name in ("beams", "rate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0.0 <= self.range_min < self.range_max < math.inf:
            raise ValueError(f"range_max must be finite and above range_min, got {self.range_min}, {self.range_max}")
        if not 0.0 < abs(self.angle_increment) * (self.beams - 1) < 2.0 * math.pi and self.beams > 1:
            raise ValueError(f"beams must lie within one turn, got {self.beams} steps of {self.angle_increment} rad")
        for name in ("noise", "dropouts", "wrong_returns", "sweep"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if max(self.dropouts, self.wrong_returns) > 1.0:
            raise ValueError(f"dropouts and wrong_returns must be at most 1, got {self.dropouts}, {self.wrong_returns}")
        if self.sweep > 1.0 / self.rate:
            raise ValueError(f"sweep must not be longer than the {1.0 / self.rate} s between scans, got {self.sweep}")
        if not self.rate <= _MOST_RATE or not self.noise <= self.range_max:
            raise ValueError(
                f"rate must be at most {_MOST_RATE:.0f} Hz and noise at most range_max, got {self.rate}, {self.noise}"
            )
        if not max(map(abs, self.T_robot_sensor)) <= _FARTHEST_MOUNT:
            raise ValueError(
                f"T_robot_sensor must be finite and within {_FARTHEST_MOUNT:.0f} m, got {tuple(self.T_robot_sensor)}"
            )

    @staticmethod
    def field_of(beams: int) -> tuple[float, float]:
        """Return the usual angle_min and angle_increment [rad] of a laser with a number of beams.

        180, 181 and 361 beams are a SICK, which sees half a turn in front of the robot. Other numbers of beams cover
        the default's 260 degrees.
        """
        if beams in _BEAMS_OVER_180_DEG:
            return -math.pi / 2.0, math.radians(_BEAMS_OVER_180_DEG[beams])
        usual = SimulatedLaser()
        return usual.angle_min, usual.angle_increment * usual.beams / max(beams, 1)

    def time_increment(self) -> float:
        """Return the time between two beams for messages [s]."""
        return float(np.float32(self.sweep / max(self.beams - 1, 1)))

    def moments(self, stamps: FloatArray) -> FloatArray:
        """Return the times (S, M) [s] at which scans at stamps (S,) need the robot's pose, one for several beams."""
        beams = self._beams_of_a_moment()
        first = np.arange(0, self.beams, beams) if self.sweep > 0.0 else np.zeros(1)
        return np.asarray(stamps[:, None] + (first + (beams - 1) / 2.0) * self.time_increment())

    def _beams_of_a_moment(self) -> int:
        """Return the number of neighbouring beams within half a millisecond, which share a pose."""
        if self.sweep == 0.0:
            return self.beams
        return max(int(_MOMENT / self.time_increment()), 1)

    def scans(
        self, world: World, stamps: FloatArray, robot_poses: FloatArray, rng: np.random.Generator
    ) -> list[LaserScan]:
        """Return the measured ranges at stamps (S,) [s] and poses (S, 3) of the robot, or (S, M, 3) at all `moments`.

        Values are rounded to float32 as in a LaserScan message; no return is `inf` (REP 117). Scans of an upside-down
        laser have a negative increment, as `LaserScan` requires.
        """
        turn = -1.0 if self.upside_down else 1.0
        angle_min, increment = (turn * float(np.float32(angle)) for angle in (self.angle_min, self.angle_increment))
        robots = robot_poses.reshape(len(stamps), -1, 3)
        beams = self._beams_of_a_moment() if robots.shape[1] > 1 else self.beams
        # Each group of beams begins where the group before ended, so the laser is rotated by their angle.
        mounts = [self.T_robot_sensor @ SE2(0.0, 0.0, moment * beams * increment) for moment in range(robots.shape[1])]
        sensors = [SE2.from_array(pose) @ mount for each in robots for pose, mount in zip(each, mounts, strict=True)]
        ranges = np.empty((len(sensors), beams))
        # Noise may shorten the range to a wall beyond the longest range.
        reach = self.range_max + 5.0 * self.noise
        cast_rays(world.walls, np.array(sensors).reshape(-1, 3), angle_min, increment, reach, ranges)
        ranges = ranges.reshape(len(stamps), robots.shape[1] * beams)[:, : self.beams]
        ranges = self._corrupted(ranges, rng).astype(np.float64)
        limits = float(np.float32(self.range_min)), float(np.float32(self.range_max))
        return [
            LaserScan(float(stamp), angle_min, increment, *limits, row, self.time_increment())
            for stamp, row in zip(stamps, ranges, strict=True)
        ]

    def _corrupted(self, exact: FloatArray, rng: np.random.Generator) -> npt.NDArray[np.float32]:
        ranges = exact + rng.normal(0.0, self.noise, exact.shape)
        chance = rng.random(exact.shape)
        early = chance < self.wrong_returns
        ranges[early] = rng.uniform(self.range_min, np.clip(exact[early], self.range_min, self.range_max))
        ranges[chance > 1.0 - self.dropouts] = np.inf
        rounded = ranges.astype(np.float32)
        rounded[(rounded < self.range_min) | (rounded > self.range_max)] = np.inf
        return rounded


class LidarPoints(NamedTuple):
    """Points (N, 3) in the sensor's frame [m], and their times after the first (N,) [s], as float32."""

    points: npt.NDArray[np.float32]
    times: npt.NDArray[np.float32]


@dataclass(frozen=True)
class RingLidar:
    """A rotating lidar of several rings; the default is similar to a Velodyne VLP-16."""

    rings: int = 16
    """Number of beams."""
    lowest: float = math.radians(-15.0)
    highest: float = math.radians(15.0)
    """Elevations of the rings, evenly spaced [rad]."""
    height: float = 0.6
    """Height of the sensor above the floor [m]."""
    ceiling: float = 2.5
    """Height of the ceiling [m]."""

    def __post_init__(self) -> None:
        """Check that the sensor is between floor and ceiling."""
        if self.rings < 1 or not -math.pi / 2.0 < self.lowest <= self.highest < math.pi / 2.0:
            raise ValueError(f"rings must be at least 1, from low to high, got {self.rings} rings")
        if not 0.0 < self.height < self.ceiling:
            raise ValueError(f"height must be between 0 and the ceiling's {self.ceiling} m, got {self.height}")

    def points(self, scan: LaserScan, noise: float, rng: np.random.Generator, *, upside_down: bool) -> LidarPoints:
        """Return the points of all rings for a scan of a level laser, seen from above.

        The ranges of the rings differ by noise with a standard deviation [m]. `upside_down` is the mount of the lidar.
        """
        angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        seconds = np.arange(len(scan.ranges)) * scan.time_increment
        elevations = np.linspace(self.lowest, self.highest, self.rings)
        level = np.tile(np.where(scan.is_hit(), scan.ranges, np.nan), (self.rings, 1))
        level += rng.normal(0.0, noise, level.shape)
        level = np.minimum(level, self._reach(elevations)[:, None])
        x, y = level * np.cos(angles), level * np.sin(angles)
        z = level * np.tan(elevations)[:, None]
        turn = -1.0 if upside_down else 1.0
        seen = np.isfinite(level).T  # a spinning lidar measures all rings of a direction together
        points = np.stack([x.T[seen], turn * y.T[seen], turn * z.T[seen]], axis=-1)
        times = np.repeat(seconds, self.rings).reshape(seen.shape)[seen]
        return LidarPoints(points.astype(np.float32), times.astype(np.float32))

    def _reach(self, elevations: FloatArray) -> FloatArray:
        """Return the distance at which each ring (R,) meets the floor or the ceiling [m]."""
        slopes = np.tan(elevations)
        room = np.where(slopes < 0.0, -self.height, self.ceiling - self.height)
        return np.asarray(np.divide(room, slopes, out=np.full(len(slopes), np.inf), where=slopes != 0.0))
