"""A slice of a point cloud, level with the floor, as a scan."""

import math
from dataclasses import dataclass

import numpy as np

from datasets.clouds.point_cloud import PointCloud
from datasets.odometry.se3 import SE3
from datasets.scans.intake import RawScan
from tbmslam.geometry.se2 import SE2, FloatArray

_TIE = 1e-6
"""Of a beam: directions midway between two beams fall to one of them, whatever rounding does to their rings."""
_WALL_DEPTH = 0.15
"""Points of one direction that are this much farther than the nearest [m] lie on the same wall: ranges are noisy."""
_WIDEST_GAP, _BESIDE = 2.0, 0.6
"""A wall is seen between points that are so many beams apart, and a point counts for beams so near: directions vary."""
_NEAREST, _FARTHEST = 0.1, 300.0
"""Limits of a range [m]; a cloud states none."""


@dataclass(frozen=True)
class CloudSlice:
    """How point clouds are cut into scans.

    Parameters
    ----------
    T_robot_sensor
        Where the sensor is mounted. Where only its place in the plane is known, heights count from the sensor.
    low, high
        Heights between which points count, above the robot's frame [m].
    angle_min, angle_step
        Direction of the first beam and angle to the next, seen from the sensor along the robot's axes [rad].
    beams
        Their number.
    time_step
        Time between two beams [s]; 0 if unknown or if all are measured at once.
    """

    T_robot_sensor: SE3
    low: float
    high: float
    angle_min: float = -math.pi
    angle_step: float = math.radians(1.0)
    beams: int = 360
    time_step: float = 0.0

    @property
    def T_robot_scan(self) -> SE2:
        """Where the scans are seen from: the sensor's place, along the robot's axes."""
        return SE2(self.T_robot_sensor.x, self.T_robot_sensor.y, 0.0)

    def scan(self, cloud: PointCloud) -> RawScan:
        """Return the scan of a cloud's slice: for each direction the range of the nearest wall, or nan."""
        points, times = self.points(cloud)
        angles = np.arctan2(points[:, 1], points[:, 0])
        ranges = np.hypot(points[:, 0], points[:, 1])
        turned = (angles - self.angle_min) / self.angle_step % (2.0 * math.pi / abs(self.angle_step))
        found = _nearest_walls(turned, ranges, self.beams)
        stamp = cloud.stamp
        if times is not None and len(times) and self.time_step > 0.0 and stamp > 0.0:
            stamp += cloud.delay + float(np.median(times - turned * self.time_step))
        return RawScan(
            stamp, self.angle_min, self.angle_step, _NEAREST, _FARTHEST, found.astype(np.float32), self.time_step
        )

    def points(self, cloud: PointCloud) -> tuple[FloatArray, FloatArray | None]:
        """Return the slice's points (N, 2), seen from the sensor along the robot's axes, and their times (N,)."""
        turned = rotation_of(self.T_robot_sensor) @ cloud.points.T
        heights = turned[2] + self.T_robot_sensor.z
        ranges = np.hypot(turned[0], turned[1])
        inside = (heights >= self.low) & (heights <= self.high) & (ranges > _NEAREST) & (ranges < _FARTHEST)
        return turned[:2, inside].T, None if cloud.times is None else cloud.times[inside]


def rotation_of(pose: SE3) -> FloatArray:
    """Return the matrix (3, 3) that turns vectors as a motion does."""
    x, y, z, w = pose.qx, pose.qy, pose.qz, pose.qw
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _nearest_walls(turned: FloatArray, ranges: FloatArray, beams: int) -> FloatArray:
    """Return the range (beams,) of the nearest wall at the middle of each beam; nan if there is none.

    Within a beam's width the points of the nearest wall are averaged, direction and range. Between two such averages of
    one wall the wall is straight: the inverse of its range is linear in the direction over so small an angle.

    Parameters
    ----------
    turned
        Directions (N,) in beams from the first.
    ranges
        Their ranges (N,) [m].
    beams
        Number of beams.
    """
    if not len(ranges):
        return np.full(beams, np.nan)
    beam = np.rint(turned + _TIE).astype(np.int64)
    offset = turned - beam
    beam %= beams
    nearest = np.full(beams, np.inf)
    np.minimum.at(nearest, beam, ranges)
    on_wall = ranges <= nearest[beam] + _WALL_DEPTH
    beam, offset, ranges = beam[on_wall], offset[on_wall], ranges[on_wall]
    counts = np.bincount(beam, minlength=beams)
    filled = np.flatnonzero(counts)
    mean = np.bincount(beam, ranges, beams)[filled] / counts[filled]
    place = filled + np.bincount(beam, offset, beams)[filled] / counts[filled]
    mean = np.concatenate((mean[-1:], mean, mean[:1]))
    place = np.concatenate((place[-1:] - beams, place, place[:1] + beams))
    middle = np.arange(beams)
    right = np.clip(np.searchsorted(place, middle), 1, len(place) - 1)
    left = right - 1
    gap, from_left = place[right] - place[left], middle - place[left]
    share = np.divide(from_left, gap, out=np.zeros(beams), where=gap > 0.0)
    between = 1.0 / ((1.0 - share) / mean[left] + share / mean[right])
    one_wall = (gap <= _WIDEST_GAP) & (np.abs(mean[right] - mean[left]) <= _WALL_DEPTH)
    alone = np.where(share <= 0.5, mean[left], mean[right])
    is_near = np.minimum(np.abs(from_left), np.abs(place[right] - middle)) <= _BESIDE
    return np.where(one_wall, between, np.where(is_near, alone, np.nan))
