"""A simulated lidar of several rings: what it sees of a building whose walls reach from the floor to the ceiling."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray
from tbmslam.sensing.laser_scan import LaserScan


class LidarPoints(NamedTuple):
    """Points (N, 3) in the sensor's frame [m], and when each was measured after the first (N,) [s], as float32."""

    points: npt.NDArray[np.float32]
    times: npt.NDArray[np.float32]


@dataclass(frozen=True)
class RingLidar:
    """Beams one above the other that turn together; the default is like a Velodyne VLP-16.

    Parameters
    ----------
    rings
        Number of beams.
    lowest, highest
        Their elevations, evenly spaced [rad].
    height
        Of the sensor above the floor [m].
    ceiling
        Height of the ceiling [m].
    """

    rings: int = 16
    lowest: float = math.radians(-15.0)
    highest: float = math.radians(15.0)
    height: float = 0.6
    ceiling: float = 2.5

    def __post_init__(self) -> None:
        """Check that it looks between floor and ceiling."""
        if self.rings < 1 or not -math.pi / 2.0 < self.lowest <= self.highest < math.pi / 2.0:
            raise ValueError(f"rings must be at least 1, from low to high, got {self.rings} rings")
        if not 0.0 < self.height < self.ceiling:
            raise ValueError(f"height must be between 0 and the ceiling's {self.ceiling} m, got {self.height}")

    def points(self, scan: LaserScan, noise: float, rng: np.random.Generator, *, upside_down: bool) -> LidarPoints:
        """Return what all rings see where a level laser of the same place saw a scan.

        Parameters
        ----------
        scan
            What the laser saw, seen from above.
        noise
            Standard deviation of a range, by which the rings differ [m].
        rng
            Draws it.
        upside_down
            Whether the lidar hangs.
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
        seen = np.isfinite(level).T  # a spinning lidar sends all rings of a direction together
        points = np.stack([x.T[seen], turn * y.T[seen], turn * z.T[seen]], axis=-1)
        times = np.repeat(seconds, self.rings).reshape(seen.shape)[seen]
        return LidarPoints(points.astype(np.float32), times.astype(np.float32))

    def _reach(self, elevations: FloatArray) -> FloatArray:
        """Return how far each ring (R,) goes until it meets the floor or the ceiling [m]."""
        slopes = np.tan(elevations)
        room = np.where(slopes < 0.0, -self.height, self.ceiling - self.height)
        return np.asarray(np.divide(room, slopes, out=np.full(len(slopes), np.inf), where=slopes != 0.0))
