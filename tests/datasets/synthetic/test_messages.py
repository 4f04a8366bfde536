import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from datasets.synthetic.messages import LASER_HEIGHT, Messages
from tbmslam.geometry.se2 import SE2


@pytest.mark.parametrize("ros1", [True, False])
def test_messages_come_back_from_their_bytes(ros1):
    messages = Messages(ros1=ros1)
    read = messages.store.deserialize_ros1 if ros1 else messages.store.deserialize_cdr
    data = messages.transform(5_000_000_007, "a", "b", SE2(1, 2, 0), height=LASER_HEIGHT)
    (stamped,) = read(data, messages.tf_type).transforms
    assert (stamped.header.stamp.sec, stamped.header.stamp.nanosec) == (5, 7)
    assert (stamped.header.frame_id, stamped.child_frame_id) == ("a", "b")
    assert stamped.transform.translation.z == 0.252
    odometry = read(messages.odometry(0, "a", "b", SE2(1, 2, np.pi), (0.5, 0.1, -0.2)), "nav_msgs/msg/Odometry")
    assert odometry.pose.pose.orientation.z == pytest.approx(1.0)
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (0.5, -0.2)


def test_the_old_tf_type_has_the_checksum_that_ros_1_knows():
    assert Messages(ros1=True).store.generate_msgdef("tf/msg/tfMessage")[1] == "94810edda583a504dfda3829e70d7eec"
    assert get_typestore(Stores.ROS1_NOETIC).generate_msgdef("sensor_msgs/msg/LaserScan")[1] == (
        "90c7ef2dc6895d81024acba2ac42f369"
    )
