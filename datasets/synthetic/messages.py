"""ROS messages of a simulated robot, in the bytes of ROS 1 or of ROS 2."""

import math
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tbmslam.geometry.se2 import SE2

LASER_HEIGHT = 0.252
"""Height of the PR2's base laser above the floor [m]."""


class Messages:
    """Makes and serialises messages with the definitions of ROS 1 Noetic or ROS 2 Humble."""

    def __init__(self, *, ros1: bool) -> None:
        self.ros1 = ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        self.tf_type = "tf/msg/tfMessage" if ros1 else "tf2_msgs/msg/TFMessage"
        if ros1:
            self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", self.tf_type))

    def scan(self, nanoseconds: int, frame: str, values: dict[str, Any]) -> bytes:
        """Return a LaserScan; `values` are its fields but header and intensities."""
        header = self._header(nanoseconds, frame)
        return self._bytes("sensor_msgs/msg/LaserScan", header=header, intensities=np.zeros(0, np.float32), **values)

    def transform(
        self, nanoseconds: int, parent: str, child: str, pose: SE2, *, height: float = 0.0, upside_down: bool = False
    ) -> bytes:
        """Return a tf message with one transform."""
        transform = self._make(
            "geometry_msgs/msg/Transform",
            translation=self._make("geometry_msgs/msg/Vector3", x=pose.x, y=pose.y, z=height),
            rotation=self._quaternion(pose.theta, upside_down=upside_down),
        )
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(nanoseconds, parent),
            child_frame_id=child,
            transform=transform,
        )
        return self._bytes(self.tf_type, transforms=[stamped])

    def odometry(
        self, nanoseconds: int, parent: str, child: str, pose: SE2, twist: tuple[float, float, float]
    ) -> bytes:
        """Return an Odometry message; `twist` is vx, vy [m/s] and omega [rad/s] in the child's frame."""
        vector, covariance = "geometry_msgs/msg/Vector3", np.zeros(36)
        posed = self._make(
            "geometry_msgs/msg/Pose",
            position=self._make("geometry_msgs/msg/Point", x=pose.x, y=pose.y, z=0.0),
            orientation=self._quaternion(pose.theta),
        )
        moving = self._make(
            "geometry_msgs/msg/Twist",
            linear=self._make(vector, x=twist[0], y=twist[1], z=0.0),
            angular=self._make(vector, x=0.0, y=0.0, z=twist[2]),
        )
        return self._bytes(
            "nav_msgs/msg/Odometry",
            header=self._header(nanoseconds, parent),
            child_frame_id=child,
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=posed, covariance=covariance),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=moving, covariance=covariance),
        )

    def _header(self, nanoseconds: int, frame: str) -> object:
        stamp = self._make("builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        sequence = {"seq": 0} if self.ros1 else {}
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **sequence)

    def _quaternion(self, yaw: float, *, upside_down: bool = False) -> object:
        """Return a turn about z, after half a turn about x for what hangs upside down."""
        cosine, sine = math.cos(yaw / 2.0), math.sin(yaw / 2.0)
        x, y, z, w = (cosine, sine, 0.0, 0.0) if upside_down else (0.0, 0.0, sine, cosine)
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _make(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def _bytes(self, name: str, **fields: object) -> bytes:
        message = self._make(name, **fields)
        return bytes(self.store.serialize_ros1(message, name) if self.ros1 else self.store.serialize_cdr(message, name))
