"""The types of messages that are read, by their standard definitions."""

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

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
    """Return the checksum of a type's standard definition in ROS 1; None where there is none."""
    if msgtype in _MD5_SUMS:
        return _MD5_SUMS[msgtype]
    store = standard_types(is_ros1=True)
    return store.generate_msgdef(msgtype)[1] if msgtype in store.fielddefs else None
