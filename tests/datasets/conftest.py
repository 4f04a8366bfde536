"""Small real bags, written message by message."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2

TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"


@dataclass
class BagScript:
    """Messages to be written, in this order: (bag time, topic, type, content)."""

    messages: list[tuple[float, str, str, Callable[[Any], Any]]] = field(default_factory=list)

    def scan(
        self,
        stamp: float,
        ranges: Any = (1.0, 2.0, 3.0),
        *,
        topic: str = "/scan",
        frame: str = "laser",
        bag_time: float | None = None,
        angle_min: float = -0.5,
        step: float = 0.5,
        limits: tuple[float, float] = (0.1, 30.0),
    ) -> "BagScript":
        values = np.asarray(ranges, dtype=np.float32)

        def build(types: Any) -> Any:
            return types["sensor_msgs/msg/LaserScan"](
                header=_header(types, stamp, frame),
                angle_min=angle_min,
                angle_max=99.0,  # never to be trusted
                angle_increment=step,
                time_increment=0.0,
                scan_time=0.0,
                range_min=limits[0],
                range_max=limits[1],
                ranges=values,
                intensities=np.zeros(0, dtype=np.float32),
            )

        return self._add(bag_time, stamp, topic, "sensor_msgs/msg/LaserScan", build)

    def cloud(self, stamp: float, points: Any, *, topic: str = "/points", frame: str = "lidar") -> "BagScript":
        """Points (N, 3) in the sensor's frame."""
        values = np.asarray(points, dtype="<f4")

        def build(types: Any) -> Any:
            field = types["sensor_msgs/msg/PointField"]
            return types["sensor_msgs/msg/PointCloud2"](
                _header(types, stamp, frame),
                height=1,
                width=len(values),
                fields=[field(name, 4 * number, 7, 1) for number, name in enumerate("xyz")],
                is_bigendian=False,
                point_step=12,
                row_step=12 * len(values),
                data=np.frombuffer(values.tobytes(), np.uint8),
                is_dense=True,
            )

        return self._add(None, stamp, topic, "sensor_msgs/msg/PointCloud2", build)

    def tf(
        self,
        stamp: float,
        parent: str,
        child: str,
        pose: SE3 | SE2 | None = None,
        *,
        topic: str = "/tf",
        bag_time: float | None = None,
        msgtype: str = "tf2_msgs/msg/TFMessage",
    ) -> "BagScript":
        spatial = SE3.from_planar(pose) if isinstance(pose, SE2) else pose or SE3.identity()

        def build(types: Any) -> Any:
            transform = types["geometry_msgs/msg/Transform"](
                translation=types["geometry_msgs/msg/Vector3"](*spatial[:3]),
                rotation=types["geometry_msgs/msg/Quaternion"](*spatial[3:]),
            )
            stamped = types["geometry_msgs/msg/TransformStamped"](_header(types, stamp, parent), child, transform)
            return types[msgtype](transforms=[stamped])

        return self._add(bag_time, stamp, topic, msgtype, build)

    def odometry(
        self,
        stamp: float,
        pose: SE2,
        *,
        topic: str = "/odom",
        frame: str = "odom",
        child: str = "base_link",
        bag_time: float | None = None,
        speed: tuple[float, float] = (0.0, 0.0),
    ) -> "BagScript":
        spatial = SE3.from_planar(pose)

        def build(types: Any) -> Any:
            vector = types["geometry_msgs/msg/Vector3"]
            return types["nav_msgs/msg/Odometry"](
                header=_header(types, stamp, frame),
                child_frame_id=child,
                pose=types["geometry_msgs/msg/PoseWithCovariance"](
                    types["geometry_msgs/msg/Pose"](
                        types["geometry_msgs/msg/Point"](*spatial[:3]),
                        types["geometry_msgs/msg/Quaternion"](*spatial[3:]),
                    ),
                    np.zeros(36),
                ),
                twist=types["geometry_msgs/msg/TwistWithCovariance"](
                    types["geometry_msgs/msg/Twist"](vector(speed[0], 0.0, 0.0), vector(0.0, 0.0, speed[1])),
                    np.zeros(36),
                ),
            )

        return self._add(bag_time, stamp, topic, "nav_msgs/msg/Odometry", build)

    def drive(self, start: float, stop: float, step: float = 0.05, **names: Any) -> "BagScript":
        """Odometry in tf: along x at 1 m/s, turning by 0.1 rad/s."""
        for stamp in np.arange(start, stop, step):
            self.tf(float(stamp), "odom", "base_link", drive_pose(float(stamp)), **names)
        return self

    def drive_of_a_late_clock(self, source: str, clocks: Iterable[float], scan_delay: float) -> "BagScript":
        """Drive 0.1 m each 0.1 s; `clocks` are the stamps, by tf or by the odometry topic, of a simulation."""
        for k, clock in enumerate(clocks):
            now, pose = 1000.0 + 0.1 * k, SE2(0.1 * k, 0.0, 0.0)
            if source == "tf":
                self.tf(clock, "odom", "base_link", pose, bag_time=now)
            else:
                self.odometry(clock, pose, bag_time=now)
            self.scan(clock, (1.0, 2.0, 3.0 + 0.01 * k), bag_time=now + scan_delay)
        return self

    def in_time_order(self) -> "BagScript":
        return BagScript(sorted(self.messages, key=lambda message: message[0]))

    def write(self, path: Path, kind: str = "none", chunk_bytes: int = 1 << 20) -> Path:
        """Write a ROS 1 bag (none, bz2, lz4) of chunks of some bytes, or a ROS 2 bag (sqlite3, mcap)."""
        is_ros1 = kind in {"none", "bz2", "lz4"}
        store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
        for name in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
            if name not in store.fielddefs:
                store.register(get_types_from_msg(TF_DEFINITION, name))
        writer: Any
        if is_ros1:
            writer = rosbag1.Writer(path)
            writer.chunk_threshold = chunk_bytes
            if kind != "none":
                writer.set_compression(rosbag1.Writer.CompressionFormat[kind.upper()])
        else:
            writer = rosbag2.Writer(path, version=9, storage_plugin=StoragePlugin[kind.upper()])
        serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
        with writer:
            connections: dict[str, Any] = {}
            for bag_time, topic, msgtype, build in self.messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, msgtype, typestore=store)
                writer.write(connections[topic], round(bag_time * 1e9), serialize(build(store.types), msgtype))
        return path

    def _add(
        self, bag_time: float | None, stamp: float, topic: str, msgtype: str, build: Callable[[Any], Any]
    ) -> "BagScript":
        self.messages.append((stamp if bag_time is None else bag_time, topic, msgtype, build))
        return self


def drive_pose(stamp: float) -> SE2:
    return SE2(stamp - 100.0, 0.0, 0.1 * (stamp - 100.0))


def _header(types: Any, stamp: float, frame: str) -> Any:
    seconds, nanoseconds = divmod(round(stamp * 1e9), 10**9)
    header = types["std_msgs/msg/Header"]
    time = types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
    return header(0, time, frame) if "seq" in header.__annotations__ else header(time, frame)


@pytest.fixture
def script() -> BagScript:
    return BagScript()


@pytest.fixture
def expected_pose() -> Callable[[float], SE2]:
    return drive_pose
