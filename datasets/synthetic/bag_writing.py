"""Real bags of simulated robots, with the topics and frames of the MIT Stata Center recordings."""

import math
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer

from datasets.rosbag.messages import TF_TYPES, standard_types
from datasets.rosbag.occupancy import LATCHED
from datasets.synthetic.robot.laser import LidarPoints, RingLidar
from datasets.synthetic.robot.simulation import SimulatedRobot
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.io.atomic_file import flush_file, replacing
from tbmslam.sensing.laser_scan import LaserScan

LASER_HEIGHT = 0.252
"""Height of the PR2's base laser above the floor [m]."""


class Messages:
    """Makes and serialises messages with the definitions of ROS 1 Noetic or ROS 2 Humble."""

    def __init__(self, *, ros1: bool) -> None:
        self.ros1 = ros1
        self.store, self.tf_type = standard_types(ros1), TF_TYPES[ros1]

    def scan(self, nanoseconds: int, frame: str, values: dict[str, Any]) -> bytes:
        """Return a LaserScan; `values` are its fields except header and intensities."""
        header = self._header(nanoseconds, frame)
        return self._bytes("sensor_msgs/msg/LaserScan", header=header, intensities=np.zeros(0, np.float32), **values)

    def cloud(self, nanoseconds: int, frame: str, seen: LidarPoints) -> bytes:
        """Return a PointCloud2 with fields x, y, z and time."""
        field, kind = self.store.types["sensor_msgs/msg/PointField"], 7
        records = np.column_stack((seen.points, seen.times))
        return self._bytes(
            "sensor_msgs/msg/PointCloud2",
            header=self._header(nanoseconds, frame),
            height=1,
            width=len(records),
            fields=[field(name, 4 * index, kind, 1) for index, name in enumerate(("x", "y", "z", "time"))],
            is_bigendian=False,
            point_step=16,
            row_step=16 * len(records),
            data=np.frombuffer(records.astype("<f4").tobytes(), np.uint8),
            is_dense=True,
        )

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
        """Return a rotation about z, after half a turn about x if mounted upside down."""
        cosine, sine = math.cos(yaw / 2.0), math.sin(yaw / 2.0)
        x, y, z, w = (cosine, sine, 0.0, 0.0) if upside_down else (0.0, 0.0, sine, cosine)
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _make(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def _bytes(self, name: str, **fields: object) -> bytes:
        message = self._make(name, **fields)
        return bytes(self.store.serialize_ros1(message, name) if self.ros1 else self.store.serialize_cdr(message, name))


SCAN_TOPIC, CLOUD_TOPIC, ODOMETRY_TOPIC = "/base_scan", "/points", "/base_odometry/odom"
ODOM_FRAME, ROBOT_FRAME, LASER_FRAME = "odom_combined", "base_footprint", "base_laser_link"

NO_RETURN = 65.533
"""Range without a return by the driver of Hokuyo lasers [m]; above any range_max."""

_SCAN_DELAY, _TRANSFORM_DELAY = 30_000_000, 1_000_000  # from a stamp to the recording of its message [ns]
_MOUNT_EVERY = 5  # ROS 1: the laser's mount is repeated with every fifth odometry sample, 10 Hz

Entry = tuple[int, str, bytes]
"""When a message is recorded [ns], on which topic, and its bytes."""


class BagWritingError(TbmSlamError):
    """A bag of ROS 2 could not be written."""


def write_ros1_bag(
    robot: SimulatedRobot,
    path: Path,
    *,
    compression: Literal["none", "bz2"] = "none",
    no_return: float = NO_RETURN,
    lidar: RingLidar | None = None,
    seed: int = 0,
) -> None:
    """Write a ROS 1 bag, whole or not at all, and replace an existing one.

    There is no compression by lz4, since ROS 1 cannot read that of `rosbags`. `no_return` is the code of a beam without
    return: `inf`, `nan`, or a number outside the laser's limits. With a lidar, point clouds replace the scans; `seed`
    is for the noise between its rings.
    """
    if compression not in {"none", "bz2"}:
        raise ValueError(f"compression must be none or bz2, got {compression!r}")
    messages = Messages(ros1=True)
    with replacing(path) as unfinished:
        writer = Rosbag1Writer(unfinished)
        if compression == "bz2":
            writer.set_compression(Rosbag1Writer.CompressionFormat.BZ2)
        with writer:
            connections = {
                topic: writer.add_connection(topic, kind, typestore=messages.store)
                for topic, kind in _topics(messages, lidar).items()
            }
            for nanoseconds, topic, data in _entries(robot, messages, no_return, lidar, seed):
                writer.write(connections[topic], nanoseconds, data)


def write_mcap_bag(
    robot: SimulatedRobot,
    path: Path,
    *,
    no_return: float = NO_RETURN,
    lidar: RingLidar | None = None,
    seed: int = 0,
) -> None:
    """Write a ROS 2 bag, a folder with metadata and one mcap file; otherwise like `write_ros1_bag`."""
    messages = Messages(ros1=False)
    with _folder_beside(path) as folder:
        unfinished = folder / path.name
        with Rosbag2Writer(unfinished, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            connections = {
                topic: writer.add_connection(
                    topic,
                    kind,
                    typestore=messages.store,
                    offered_qos_profiles=[LATCHED] if topic == "/tf_static" else [],
                )
                for topic, kind in _topics(messages, lidar).items()
            }
            for nanoseconds, topic, data in _entries(robot, messages, no_return, lidar, seed):
                writer.write(connections[topic], nanoseconds, data)
        for file in sorted(unfinished.iterdir()):
            flush_file(file)
        shutil.rmtree(path, ignore_errors=True)  # if anything stays, the next line says why
        unfinished.replace(path)


@contextmanager
def _folder_beside(path: Path) -> Iterator[Path]:
    """Provide a folder for the parts of a bag during a block; an error of the file system is a `BagWritingError`."""
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
            yield Path(folder)
    except OSError as error:
        raise BagWritingError(f"{path} cannot be written: {error.strerror}; choose another place with -o") from error


def _topics(messages: Messages, lidar: RingLidar | None) -> dict[str, str]:
    scans = (SCAN_TOPIC, "sensor_msgs/msg/LaserScan") if lidar is None else (CLOUD_TOPIC, "sensor_msgs/msg/PointCloud2")
    topics = {scans[0]: scans[1], ODOMETRY_TOPIC: "nav_msgs/msg/Odometry", "/tf": messages.tf_type}
    return topics if messages.ros1 else {**topics, "/tf_static": messages.tf_type}


def _entries(
    robot: SimulatedRobot, messages: Messages, no_return: float, lidar: RingLidar | None, seed: int
) -> list[Entry]:
    """Return all messages in the order of their recording."""
    scans = _scan_entries(robot, messages, no_return) if lidar is None else _cloud_entries(robot, messages, lidar, seed)
    height = LASER_HEIGHT if lidar is None else lidar.height
    return sorted([*_odometry_entries(robot, messages, height), *scans], key=lambda e: e[0])


def _odometry_entries(robot: SimulatedRobot, messages: Messages, height: float) -> Iterator[Entry]:
    mount_topic = "/tf" if messages.ros1 else "/tf_static"
    steps = np.diff(robot.odometry.stamps, append=np.inf)
    for index in range(len(robot.odometry)):
        stamp, pose = _nanoseconds(float(robot.odometry.stamps[index])), robot.odometry.pose(index)
        if index == 0 or (messages.ros1 and index % _MOUNT_EVERY == 0):
            mount, is_down = robot.readings[0].T_robot_sensor, robot.laser.upside_down
            data = messages.transform(stamp, ROBOT_FRAME, LASER_FRAME, mount, height=height, upside_down=is_down)
            yield stamp, mount_topic, data
        after = robot.odometry.pose(min(index + 1, len(robot.odometry) - 1))
        vx, vy, omega = (rate / float(steps[index]) for rate in (pose.inverse() @ after).log())
        data = messages.odometry(stamp, ODOM_FRAME, ROBOT_FRAME, pose, (vx, vy, omega))
        yield stamp + _TRANSFORM_DELAY, ODOMETRY_TOPIC, data
        yield stamp + _TRANSFORM_DELAY, "/tf", messages.transform(stamp, ODOM_FRAME, ROBOT_FRAME, pose)


def _scan_entries(robot: SimulatedRobot, messages: Messages, no_return: float) -> Iterator[Entry]:
    for reading, taken in zip(robot.readings, robot.recorded.tolist(), strict=True):
        fields = _scan_fields(reading.scan, robot, no_return)
        data = messages.scan(_nanoseconds(reading.scan.stamp), LASER_FRAME, fields)
        yield _nanoseconds(taken) + _SCAN_DELAY, SCAN_TOPIC, data


def _cloud_entries(robot: SimulatedRobot, messages: Messages, lidar: RingLidar, seed: int) -> Iterator[Entry]:
    rng = np.random.default_rng([seed, int(robot.name.rpartition("_")[2]), lidar.rings])
    for reading, taken in zip(robot.readings, robot.recorded.tolist(), strict=True):
        seen = lidar.points(reading.scan, robot.laser.noise, rng, upside_down=robot.laser.upside_down)
        data = messages.cloud(_nanoseconds(reading.scan.stamp), LASER_FRAME, seen)
        yield _nanoseconds(taken) + _SCAN_DELAY, CLOUD_TOPIC, data


def _scan_fields(scan: LaserScan, robot: SimulatedRobot, no_return: float) -> dict[str, object]:
    """Return the message's fields; a hanging laser reports in its own frame, in which its beams turn the usual way."""
    turn = -1.0 if robot.laser.upside_down else 1.0
    first, step = turn * scan.angle_min, turn * scan.angle_increment
    return {
        "angle_min": first,
        "angle_increment": step,
        "angle_max": first + (len(scan.ranges) - 1) * step,
        "time_increment": scan.time_increment,
        "scan_time": 1.0 / robot.laser.rate,
        "range_min": scan.range_min,
        "range_max": scan.range_max,
        "ranges": np.where(np.isposinf(scan.ranges), no_return, scan.ranges).astype(np.float32),
    }


def _nanoseconds(stamp: float) -> int:
    """Return a stamp of whole microseconds exactly."""
    return round(stamp * 1e6) * 1000
