"""The ROS messages that are read: their standard definitions, and their content as this project's types."""

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from datasets.odometry.se3 import SE3
from datasets.scans.intake import RawScan
from tbmslam.io.printable import printable

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ECHOES_TYPE = "sensor_msgs/msg/MultiEchoLaserScan"
CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
POSE_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"

_MD5_SUMS = {
    SCAN_TYPE: "90c7ef2dc6895d81024acba2ac42f369",
    ODOMETRY_TYPE: "cd5e73d190d741a2f92e81eda573aca7",
    **dict.fromkeys(TF_TYPES, "94810edda583a504dfda3829e70d7eec"),
}
"""Of the definitions in ROS 1; to load all that there are takes longer than to read a small bag."""


@cache
def standard_types(is_ros1: bool) -> "Typestore":
    """Return the standard message definitions, with both names of the tf message.

    They are the same ones each time, as rosbags makes the code that decodes a type when it is first used.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - mostly not needed

    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name in TF_TYPES:
        if name not in store.fielddefs:
            store.register(get_types_from_msg(_TF_DEFINITION, name))
    return store


def standard_md5_sum(msgtype: str) -> str | None:
    """Return the checksum of a type's standard definition in ROS 1; None if there is none."""
    if msgtype in _MD5_SUMS:
        return _MD5_SUMS[msgtype]
    store = standard_types(is_ros1=True)
    return store.generate_msgdef(msgtype)[1] if msgtype in store.fielddefs else None


class StampedTransform(NamedTuple):
    """One edge of tf at a time; `pose` carries coordinates from child to parent; a stamp of 0 or less is unset."""

    parent: str
    child: str
    stamp: float
    pose: SE3

    def stamp_or(self, unset: float) -> float:
        """Return the stamp [s], or the given one if it is unset."""
        return self.stamp if self.stamp > 0.0 else unset


class FramedScan(NamedTuple):
    """A scan and the frame of the laser that made it; a stamp of 0 or less is unset."""

    frame: str
    scan: RawScan

    def stamped(self, unset: float) -> RawScan:
        """Return the scan, with the given stamp [s] if its own is unset."""
        return self.scan if self.scan.stamp > 0.0 else self.scan._replace(stamp=unset)


def scan_of(message: Any) -> FramedScan:
    """Read a LaserScan, or of a MultiEchoLaserScan the first echoes, nan if a beam has none."""
    ranges = message.ranges
    if not isinstance(ranges, np.ndarray):
        first = [beam.echoes[0] if len(beam.echoes) else np.nan for beam in ranges]
        ranges = np.array(first, dtype=np.float32)
    scan = RawScan(
        stamp_of(message.header),
        float(message.angle_min),
        float(message.angle_increment),
        float(message.range_min),
        float(message.range_max),
        ranges,
        float(message.time_increment),
    )
    return FramedScan(printable(message.header.frame_id), scan)


def transforms_of(message: Any) -> Iterator[StampedTransform]:
    """Read a TFMessage, without invalid poses."""
    for item in message.transforms:
        t, q = item.transform.translation, item.transform.rotation
        pose = SE3.from_values(t.x, t.y, t.z, q.x, q.y, q.z, q.w)
        if pose is not None:
            parent, child = printable(item.header.frame_id), printable(item.child_frame_id)
            yield StampedTransform(parent, child, stamp_of(item.header), pose)


def poses_of(message: Any) -> Iterator[StampedTransform]:
    """Read an Odometry or PoseWithCovarianceStamped, which holds one pose; none where it is no motion."""
    p, q = message.pose.pose.position, message.pose.pose.orientation
    pose = SE3.from_values(p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    if pose is not None:
        child = printable(getattr(message, "child_frame_id", ""))
        yield StampedTransform(printable(message.header.frame_id), child, stamp_of(message.header), pose)


def stamp_of(header: Any) -> float:
    """Return a header's stamp [s]."""
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)
