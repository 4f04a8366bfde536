"""Odometry whose driver fills in velocities only: all of its poses are one and the same."""

from collections.abc import Collection
from typing import Any

from datasets.odometry.frames import plain
from datasets.odometry.se3 import SE3
from datasets.rosbag.files import BagFiles
from datasets.rosbag.messages import ODOMETRY_TYPE, poses_of, transforms_of

_MOVED_M, _TURNED = 0.1, 0.5
"""Motion by the velocities [m, rad] that contradicts a constant pose: noise and the drift of a gyroscope stay below."""
_LONGEST_STEP_S = 0.5  # a velocity holds until the next message, but not over a pause


def holds_only_velocities(
    files: BagFiles, topic: str, transforms: Collection[str] = (), edges: Collection[tuple[str, str]] = ()
) -> bool:
    """Return whether all poses of a topic are equal to the bit, although its velocities state a motion.

    `edges` of tf, by parent and child, on the topics `transforms` must be constant, too. The recording is read up to
    the first pose that differs, since a robot may stand still for long at first.
    """
    if files.topics[topic].msgtype != ODOMETRY_TYPE:
        return False
    known: dict[tuple[str, str] | None, SE3] = {}
    last, moved, farthest = None, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    for msgtype, time, message in files.whole_messages([topic, *transforms], topic):
        if msgtype == ODOMETRY_TYPE:
            poses: list[tuple[tuple[str, str] | None, SE3]] = [(None, item.pose) for item in poses_of(message)]
            passed = 0.0 if last is None else min(max(time - last, 0.0), _LONGEST_STEP_S)
            moved = [sum_ + passed * speed for sum_, speed in zip(moved, _speeds(message), strict=True)]
            farthest = [max(far, abs(sum_)) for far, sum_ in zip(farthest, moved, strict=True)]
            last = time
        else:
            stated = [((plain(item.parent), plain(item.child)), item.pose) for item in transforms_of(message)]
            poses = [(edge, pose) for edge, pose in stated if edge in edges]
        if any(known.setdefault(edge, pose) != pose for edge, pose in poses):
            return False
    ahead, left, turned = farthest  # at any time: a robot may drive back to where it started
    return None in known and (max(ahead, left) > _MOVED_M or turned > _TURNED)


def _speeds(message: Any) -> tuple[float, float, float]:
    """Return the velocity of an Odometry in the plane [m/s, m/s, rad/s]."""
    twist = message.twist.twist
    return twist.linear.x, twist.linear.y, twist.angular.z
