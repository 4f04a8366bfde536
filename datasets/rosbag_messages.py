"""Decoded ROS messages as this project's types.

Of each the caller says what counts for a stamp that is unset, that is zero.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from datasets.scan_intake import RawScan
from datasets.se3 import SE3


class StampedTransform(NamedTuple):
    """One edge of tf at a time; `pose` carries coordinates from child to parent."""

    parent: str
    child: str
    stamp: float
    pose: SE3


def stamp_of(header: Any, unset: float) -> float:
    """Return a header's stamp [s], or what counts for it where it was left at zero."""
    stamp = header.stamp.sec + 1e-9 * header.stamp.nanosec
    return float(stamp) if stamp > 0.0 else unset


def scan_of(message: Any, unset: float) -> RawScan:
    """Read a LaserScan, or of a MultiEchoLaserScan the first echoes, nan where a beam has none."""
    ranges = message.ranges
    if not isinstance(ranges, np.ndarray):
        first = [beam.echoes[0] if len(beam.echoes) else np.nan for beam in ranges]
        ranges = np.array(first, dtype=np.float32)
    return RawScan(
        stamp_of(message.header, unset),
        float(message.angle_min),
        float(message.angle_increment),
        float(message.range_min),
        float(message.range_max),
        ranges,
        float(message.time_increment),
    )


def transforms_of(message: Any, unset: float) -> Iterator[StampedTransform]:
    """Read a TFMessage, leaving out what is no motion."""
    for item in message.transforms:
        t, q = item.transform.translation, item.transform.rotation
        pose = SE3.from_values(t.x, t.y, t.z, q.x, q.y, q.z, q.w)
        if pose is not None:
            yield StampedTransform(item.header.frame_id, item.child_frame_id, stamp_of(item.header, unset), pose)


def pose_of(message: Any, unset: float) -> StampedTransform | None:
    """Read an Odometry or PoseWithCovarianceStamped; None where it is no motion."""
    p, q = message.pose.pose.position, message.pose.pose.orientation
    pose = SE3.from_values(p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    child = getattr(message, "child_frame_id", "")
    if pose is None:
        return None
    return StampedTransform(message.header.frame_id, child, stamp_of(message.header, unset), pose)
