"""The logic of the node without ROS: messages in, poses and maps out."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tbmslam import SE2, LaserScan, Reading, Slam, TbmMap, save_map


def planar(translation: Any, rotation: Any) -> SE2:
    """Return a geometry_msgs Transform's or Pose's motion in the plane."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    heading = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return SE2(translation.x, translation.y, heading)


def stamp_of(message: Any) -> float:
    """Return the time of a message with a header [s]."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def scan_of(message: Any) -> LaserScan:
    """Convert a sensor_msgs/LaserScan; ranges beyond the limits mean no return."""
    ranges = np.asarray(message.ranges, dtype=np.float64)
    ranges = np.where(ranges >= message.range_max, np.inf, ranges)
    ranges[~(ranges >= message.range_min)] = np.nan
    angles = message.angle_min, message.angle_increment
    return LaserScan(stamp_of(message), *angles, message.range_min, message.range_max, ranges)


@dataclass(frozen=True)
class Occupancy:
    """The fields of a nav_msgs/OccupancyGrid."""

    resolution: float
    width: int
    height: int
    origin_x: float
    origin_y: float
    data: list[int]


class LiveMap:
    """A map that grows with every scan."""

    def __init__(self, name: str = "robot") -> None:
        self._slam = Slam(name=name)
        self.scans = 0

    def add(self, message: Any, T_odom_robot: SE2, T_robot_sensor: SE2) -> SE2:
        """Place a LaserScan message and return T_map_odom, which tf is to hold from now on."""
        T_map_robot = self._slam.process(Reading(scan_of(message), T_odom_robot, T_robot_sensor))
        self.scans += 1
        return T_map_robot @ T_odom_robot.inverse()

    def finished(self) -> TbmMap:
        """Return the map of all scans so far; more may come after it."""
        return self._slam.finish()

    def save(self, folder: str) -> None:
        """Write the map's folder."""
        save_map(folder, self.finished())


def occupancy(tbm_map: TbmMap) -> Occupancy:
    """Return what a message holds of a map."""
    geometry = tbm_map.grid.geometry
    return Occupancy(
        geometry.resolution,
        geometry.cols,
        geometry.rows,
        geometry.origin_x,
        geometry.origin_y,
        tbm_map.to_occupancy().ravel().tolist(),
    )
