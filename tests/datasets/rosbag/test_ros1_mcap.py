"""Messages of ROS 1 in an MCAP file, as the `mcap convert` of a bag writes them."""

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags import rosbag1

from datasets import DatasetError, open_recording
from datasets.rosbag.occupancy import read_occupancy_bag, write_occupancy_bag
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tests.datasets.rosbag.test_velocities import drive

SCANS = 60


def converted(bag, *, profile="ros1", **metadata):
    """Return the MCAP file with the messages of a ROS 1 bag."""
    path = bag.with_suffix(".mcap")
    writer = Writer(str(path))
    writer.start(profile=profile)
    with rosbag1.Reader(bag) as reader:
        channels = {}
        for connection in reader.connections:
            name = connection.msgtype.replace("/msg/", "/")
            schema = writer.register_schema(name, "ros1msg", connection.msgdef.data.encode())
            own = {"md5sum": connection.digest, **metadata}
            channels[connection.id] = writer.register_channel(connection.topic, "ros1", schema, own)
        for connection, time, data in reader.messages():
            writer.add_message(channels[connection.id], time, bytes(data), time)
    writer.finish()
    return path


@pytest.fixture
def bag(script, tmp_path):
    """A drive whose odometry is in tf."""
    script.tf(100.0, "base_link", "laser", topic="/tf_static", msgtype="tf/msg/tfMessage").drive(100.0, 107.0)
    for k in range(SCANS):
        script.scan(100.5 + 0.1 * k, np.full(181, 3.0 + 0.01 * k), step=0.01)
    return script.in_time_order().write(tmp_path / "run.bag")


@pytest.mark.parametrize("profile", ["ros1", "", "ros2"])
def test_messages_of_ros_1_are_read_as_from_the_bag(bag, caplog, profile):
    expected = list(open_recording([bag]))
    found = list(open_recording([converted(bag, profile=profile)]))
    assert len(found) == len(expected) == SCANS
    for reading, other in zip(found, expected, strict=True):
        assert reading.scan.stamp == other.scan.stamp
        np.testing.assert_array_equal(reading.scan.ranges, other.scan.ranges)
        np.testing.assert_array_equal(reading.T_odom_robot, other.T_odom_robot)
    assert caplog.text == ""


def test_another_definition_of_a_standard_type_is_refused(bag):
    with pytest.raises(DatasetError, match=r"run\.mcap: /tf_static is no standard tf/msg/tfMessage \(checksum 0000"):
        list(open_recording([converted(bag, md5sum="0" * 32)]))


def test_a_map_of_ros_1_is_read(tmp_path):
    grid = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 5, 7))
    write_occupancy_bag(tmp_path / "map.bag", grid, 100.0)
    assert read_occupancy_bag(converted(tmp_path / "map.bag")).geometry == grid.geometry


def test_velocities_without_poses_are_no_odometry(script, tmp_path, caplog):
    path = converted(drive(script, (0.5, 0.0), starts=1e9).write(tmp_path / "run.bag"))
    assert open_recording([path]).description["odometry"] == "none"
    assert "/odom holds velocities, but one and the same pose" in caplog.text
