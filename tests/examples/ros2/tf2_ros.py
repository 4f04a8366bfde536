"""A stand-in for tf2_ros, which has no wheel: motion in the plane, and a topic of messages with one transform.

Names, arguments, callback groups and errors are those of tf2_ros. Transforms are interpolated, and never extrapolated.
"""

import math
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from tbmslam import SE2

TOPIC, STATIC_TOPIC = "/tf_one", "/tf_static_one"
QUEUE = QoSProfile(depth=100)
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class TransformException(Exception):  # noqa: N818 - the name is tf2_ros's
    """A transform is not known at a time."""


def message_of(parent: str, child: str, stamp: Any, pose: SE2) -> TransformStamped:
    """Return a motion in the plane as a message."""
    said = TransformStamped()
    said.header.stamp, said.header.frame_id, said.child_frame_id = stamp, parent, child
    said.transform.translation.x, said.transform.translation.y = float(pose.x), float(pose.y)
    said.transform.rotation.z, said.transform.rotation.w = math.sin(pose.theta / 2.0), math.cos(pose.theta / 2.0)
    return said


class Buffer:
    """Transforms between pairs of frames."""

    def __init__(self) -> None:
        self._moving: dict[tuple[str, str], list[tuple[int, SE2]]] = {}
        self._static: dict[tuple[str, str], SE2] = {}

    def take(self, message: TransformStamped, *, static: bool = False) -> None:
        """Keep a transform."""
        turn, shift = message.transform.rotation, message.transform.translation
        pair = message.header.frame_id, message.child_frame_id
        pose = SE2(shift.x, shift.y, 2.0 * math.atan2(turn.z, turn.w))
        if static:
            self._static[pair] = pose
        else:
            self._moving.setdefault(pair, []).append((Time.from_msg(message.header.stamp).nanoseconds, pose))

    def lookup_transform(self, target: str, source: str, stamp: Time) -> TransformStamped:
        """Return the pose of one frame in another."""
        if (target, source) in self._static:
            return message_of(target, source, stamp.to_msg(), self._static[target, source])
        known = list(self._moving.get((target, source), []))
        after = next((index for index, (time, _) in enumerate(known) if time >= stamp.nanoseconds), None)
        if after is None or (after == 0 and known[0][0] > stamp.nanoseconds):
            raise TransformException(f"{source} in {target} is not known at {stamp.nanoseconds} ns")
        (begin, first), (end, second) = known[max(after - 1, 0)], known[after]
        share = (stamp.nanoseconds - begin) / (end - begin) if end > begin else 0.0
        step = first.inverse() @ second
        moved = first @ SE2(share * step.x, share * step.y, share * step.theta)
        return message_of(target, source, stamp.to_msg(), moved)


class TransformListener:
    """Fills a buffer."""

    def __init__(self, buffer: Buffer, node: Node) -> None:
        group = ReentrantCallbackGroup()
        node.create_subscription(TransformStamped, TOPIC, buffer.take, QUEUE, callback_group=group)
        node.create_subscription(
            TransformStamped, STATIC_TOPIC, lambda told: buffer.take(told, static=True), LATCHED, callback_group=group
        )


class TransformBroadcaster:
    """Publishes transforms."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(TransformStamped, TOPIC, QUEUE)

    def sendTransform(self, message: TransformStamped) -> None:
        """Publish a transform."""
        self._publisher.publish(message)
