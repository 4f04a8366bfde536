import json
import shutil
import subprocess

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory, QosReliability
from rosbags.typesys import Stores, get_typestore

from datasets.rosbag.occupancy import write_occupancy_bag
from tbmslam.belief.grid import GridGeometry, TbmGrid, occupancy_of
from tbmslam.io.atomic_file import FileNotWrittenError
from tbmslam.io.ros_map import read_ros_map_header, write_ros_map
from tbmslam.map.map_image import occupancy_of_image, read_image

GEOMETRY = GridGeometry(0.05, -1.25, 3.5, 21, 13)
STAMP = 1295883467.123456

READ_BY_ROS = """
import json, sys, rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    for topic, message, time in bag.read_messages():
        info = message.info
        print(json.dumps([topic, message._type, message.header.frame_id, time.to_nsec(), info.resolution, info.width,
                          info.height, info.origin.position.x, info.origin.position.y, list(message.data)]))
"""


@pytest.fixture
def grid():
    masses = np.random.default_rng(0).dirichlet([0.2, 1.0, 1.0, 1.0], size=(21, 13)).astype(np.float32)
    return TbmGrid(GEOMETRY, masses)


def test_the_values_are_those_of_map_server(grid, tmp_path):
    write_ros_map(tmp_path / "map.yaml", grid)
    header = read_ros_map_header(tmp_path / "map.yaml")
    np.testing.assert_array_equal(occupancy_of(grid), occupancy_of_image(read_image(header.image), header.pixels))
    assert set(np.unique(occupancy_of(grid))) == {-1, 0, 100}


@pytest.mark.parametrize(
    ("kind", "name", "store"), [("ros1", "map.bag", Stores.ROS1_NOETIC), ("mcap", "map.mcap", Stores.ROS2_HUMBLE)]
)
def test_rosbags_reads_the_map(grid, tmp_path, kind, name, store):
    write_occupancy_bag(tmp_path / name, grid, STAMP, kind)
    with AnyReader([tmp_path / name], default_typestore=get_typestore(store)) as reader:
        ((connection, time, data),) = reader.messages()
        message = reader.deserialize(data, connection.msgtype)
    assert (connection.topic, connection.msgtype, time) == ("/map", "nav_msgs/msg/OccupancyGrid", 1295883467123456000)
    assert (message.info.width, message.info.height) == (13, 21)
    assert message.info.resolution == np.float32(0.05)
    assert (message.info.origin.position.x, message.info.origin.position.y) == (-1.25, 3.5)
    np.testing.assert_array_equal(message.data.reshape(21, 13), occupancy_of(grid))
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_viewers_that_subscribe_later_receive_the_map(grid, tmp_path):
    write_occupancy_bag(tmp_path / "map.mcap", grid, STAMP, "mcap")
    with AnyReader([tmp_path / "map.mcap"], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        (connection,) = reader.connections
    (offered,) = connection.ext.offered_qos_profiles
    assert (offered.durability, offered.reliability) == (QosDurability.TRANSIENT_LOCAL, QosReliability.RELIABLE)
    assert (offered.history, offered.depth) == (QosHistory.KEEP_LAST, 1)


@pytest.mark.skipif(shutil.which("rosbag") is None, reason="ROS 1's own rosbag is not installed")
def test_the_genuine_rosbag_reads_the_map(grid, tmp_path):
    write_occupancy_bag(tmp_path / "map.bag", grid, STAMP)
    command = ["/usr/bin/python3", "-c", READ_BY_ROS, str(tmp_path / "map.bag")]
    done = subprocess.run(command, capture_output=True, check=True, text=True, timeout=60, env={})  # noqa: S603 - ROS's
    said = json.loads(done.stdout)
    assert said[:4] == ["/map", "nav_msgs/OccupancyGrid", "map", 1295883467123456000]
    assert said[4:9] == pytest.approx([0.05, 13, 21, -1.25, 3.5])
    assert said[9] == occupancy_of(grid).ravel().tolist()


def test_a_map_without_a_time_is_written_too(grid, tmp_path):
    write_occupancy_bag(tmp_path / "map.bag", grid, 0.0)
    assert (tmp_path / "map.bag").stat().st_size > 273


def test_wrong_kinds_and_places_are_named(grid, tmp_path):
    with pytest.raises(ValueError, match="kind must be ros1 or mcap, got 'db3'"):
        write_occupancy_bag(tmp_path / "a", grid, 0.0, "db3")
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(FileNotWrittenError, match=r"map\.bag: cannot be written"):
        write_occupancy_bag(tmp_path / "taken" / "map.bag", grid, 0.0)
