"""Decoded ROS messages as this project's types."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from datasets.scan_intake import RawScan
from datasets.se3 import SE3


class StampedTransform(NamedTuple):
    """One edge of tf at a time; `pose` carries coordinates from child to parent."""

    parent: str
    child: str
    stamp: float
    pose: SE3


def stamp_of(header: Any, bag_time: float) -> float:
    """Return a header's stamp [s]; the bag time where a recorder left it at zero."""
    stamp = header.stamp.sec + 1e-9 * header.stamp.nanosec
    return float(stamp) if stamp > 0.0 else bag_time


def scan_of(message: Any, bag_time: float) -> RawScan:
    """Read a LaserScan."""
    return RawScan(
        stamp_of(message.header, bag_time),
        float(message.angle_min),
        float(message.angle_increment),
        float(message.range_min),
        float(message.range_max),
        message.ranges,
        float(message.time_increment),
    )


def transforms_of(message: Any, bag_time: float) -> Iterator[StampedTransform]:
    """Read a TFMessage, leaving out what is no motion."""
    for item in message.transforms:
        t, q = item.transform.translation, item.transform.rotation
        pose = SE3.from_values(t.x, t.y, t.z, q.x, q.y, q.z, q.w)
        if pose is not None:
            yield StampedTransform(item.header.frame_id, item.child_frame_id, stamp_of(item.header, bag_time), pose)


def pose_of(message: Any, bag_time: float) -> StampedTransform | None:
    """Read an Odometry or PoseWithCovarianceStamped; None where it is no motion."""
    p, q = message.pose.pose.position, message.pose.pose.orientation
    pose = SE3.from_values(p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    child = getattr(message, "child_frame_id", "")
    if pose is None:
        return None
    return StampedTransform(message.header.frame_id, child, stamp_of(message.header, bag_time), pose)
