import math
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from datasets.synthetic.bag_writing import LASER_HEIGHT, BagWritingError, Messages, write_mcap_bag, write_ros1_bag
from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import RingLidar, SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from tbmslam.geometry.se2 import SE2
from tbmslam.io.atomic_file import FileNotWrittenError

WORLD = make_world("apartment", 1)
DRIVES = plan_drives(WORLD, 1, duration=4.0)
LASER = SimulatedLaser(beams=200, angle_increment=0.02, dropouts=0.05, T_robot_sensor=SE2(0.1, -0.2, 0.5))
(ROBOT,) = simulate(WORLD, DRIVES, LASER, OdometryNoise.preset("good"))


def messages(path, ros1):
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=store) as reader:
        found = {}
        for connection, stamp, raw in reader.messages():
            found.setdefault(connection.topic, []).append((stamp, reader.deserialize(raw, connection.msgtype)))
        return {c.topic: c.msgtype for c in reader.connections}, found


def pose_of(transform):
    x, y, z, w = (getattr(transform.rotation, axis) for axis in "xyzw")
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return SE2(transform.translation.x, transform.translation.y, yaw)


@pytest.mark.parametrize("kind", ["none", "bz2", "mcap"])
def test_what_was_simulated_is_in_the_bag(tmp_path, kind):
    ros1 = kind != "mcap"
    path = tmp_path / ("robot_0.bag" if ros1 else "robot_0")
    if ros1:
        write_ros1_bag(ROBOT, path, compression=kind)
    else:
        write_mcap_bag(ROBOT, path)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    types, found = messages(path, ros1)
    assert types["/tf"] == ("tf/msg/tfMessage" if ros1 else "tf2_msgs/msg/TFMessage")
    assert len(found["/base_scan"]) == len(ROBOT.readings) == 80
    for (_, message), reading in zip(found["/base_scan"], ROBOT.readings, strict=True):
        assert message.header.frame_id == "base_laser_link"
        assert message.header.stamp.sec + message.header.stamp.nanosec * 1e-9 == reading.scan.stamp
        assert message.angle_min == pytest.approx(reading.scan.angle_min)
        hit = reading.scan.is_hit()
        np.testing.assert_array_equal(message.ranges[hit], reading.scan.ranges[hit])
        assert (message.ranges[~hit] > message.range_max).all()
    check_transforms(found, ros1)


def check_transforms(found, ros1):
    transforms = [t for topic in ("/tf", "/tf_static") for _, m in found.get(topic, []) for t in m.transforms]
    mounts = [t for t in transforms if t.child_frame_id == "base_laser_link"]
    assert {t.header.frame_id for t in mounts} == {"base_footprint"}
    assert len(mounts) == (41 if ros1 else 1)
    assert pose_of(mounts[0].transform) == pytest.approx(LASER.T_robot_sensor)
    moving = [t for t in transforms if t.child_frame_id == "base_footprint"]
    poses = np.array([pose_of(t.transform) for t in moving])
    np.testing.assert_allclose(poses, ROBOT.odometry.poses, atol=1e-9)
    assert {t.header.frame_id for t in moving} == {"odom_combined"}
    odometry = [message for _, message in found["/base_odometry/odom"]]
    np.testing.assert_allclose([m.pose.pose.position.x for m in odometry], ROBOT.odometry.poses[:, 0])
    speeds = np.array([m.twist.twist.linear.x for m in odometry])
    assert abs(speeds.mean() * 4.0 - ROBOT.odometry.length()) < 0.1


def test_an_upside_down_laser_is_stated_by_tf_only(tmp_path):
    (robot,) = simulate(WORLD, DRIVES, SimulatedLaser(upside_down=True), OdometryNoise.preset("none"))
    write_ros1_bag(robot, tmp_path / "down.bag")
    _, found = messages(tmp_path / "down.bag", ros1=True)
    assert found["/base_scan"][0][1].angle_increment > 0 > robot.readings[0].scan.angle_increment
    rotation = found["/tf"][0][1].transforms[0].transform.rotation
    assert (rotation.x, rotation.y, rotation.z, rotation.w) == (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("code", [math.inf, math.nan, 0.0])
def test_codes_of_no_return(tmp_path, code):
    write_ros1_bag(ROBOT, tmp_path / "a.bag", no_return=code)
    _, found = messages(tmp_path / "a.bag", ros1=True)
    missing = ~ROBOT.readings[0].scan.is_hit()
    assert missing.any()
    np.testing.assert_array_equal(found["/base_scan"][0][1].ranges[missing], code)


def test_a_beam_that_knows_nothing_stays_so(tmp_path):
    readings = list(ROBOT.readings)
    ranges = readings[0].scan.ranges.copy()
    ranges[:3] = np.nan
    readings[0] = replace(readings[0], scan=replace(readings[0].scan, ranges=ranges))
    write_ros1_bag(replace(ROBOT, readings=tuple(readings)), tmp_path / "a.bag")
    _, found = messages(tmp_path / "a.bag", ros1=True)
    assert np.isnan(found["/base_scan"][0][1].ranges).nonzero()[0].tolist() == [0, 1, 2]


def test_same_bytes_twice_and_an_older_bag_is_replaced(tmp_path):
    write_ros1_bag(ROBOT, tmp_path / "a.bag")
    first = (tmp_path / "a.bag").read_bytes()
    (tmp_path / "a.bag").write_bytes(b"old")
    write_ros1_bag(ROBOT, tmp_path / "a.bag")
    assert (tmp_path / "a.bag").read_bytes() == first
    write_mcap_bag(ROBOT, tmp_path / "m")
    first = {file.name: file.read_bytes() for file in (tmp_path / "m").iterdir()}
    assert sorted(first) == ["m.mcap", "metadata.yaml"]
    (tmp_path / "m" / "stray").touch()
    write_mcap_bag(ROBOT, tmp_path / "m")
    assert {file.name: file.read_bytes() for file in (tmp_path / "m").iterdir()} == first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bag", "m"]


def test_each_seed_and_robot_has_other_noise_between_the_rings(tmp_path):
    def clouds(robot, seed):
        write_ros1_bag(robot, tmp_path / "a.bag", lidar=RingLidar(2), seed=seed)
        return [message.data.tobytes() for _, message in messages(tmp_path / "a.bag", ros1=True)[1]["/points"]]

    first = clouds(ROBOT, 0)
    assert clouds(ROBOT, 0) == first
    assert not set(first) & set(clouds(ROBOT, 1))
    assert not set(first) & set(clouds(replace(ROBOT, name="robot_1"), 0))


def test_a_failed_write_leaves_the_older_bag_and_nothing_else(tmp_path, monkeypatch):
    for write, name in ((write_ros1_bag, "a.bag"), (write_mcap_bag, "m")):
        write(ROBOT, tmp_path / name)

    def full(*_args):
        raise OSError(28, "No space left on device")

    for module in ("tbmslam.io.atomic_file", "datasets.synthetic.bag_writing"):
        monkeypatch.setattr(f"{module}.flush_file", full)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(FileNotWrittenError, match=r"a\.bag: cannot be written \(No space left on device\): choose an"):
        write_ros1_bag(ROBOT, tmp_path / "a.bag")
    with pytest.raises(BagWritingError, match="m cannot be written: No space left on device; choose another place"):
        write_mcap_bag(ROBOT, tmp_path / "m")
    assert sorted(tmp_path.rglob("*")) == before


def test_lz4_is_refused(tmp_path):
    with pytest.raises(ValueError, match="compression must be none or bz2, got 'lz4'"):
        write_ros1_bag(ROBOT, tmp_path / "a.bag", compression="lz4")


@pytest.mark.skipif(shutil.which("rosbag") is None, reason="ROS 1's own rosbag is not installed")
@pytest.mark.parametrize("compression", ["none", "bz2"])
def test_the_genuine_rosbag_reads_the_bag(tmp_path, compression):
    write_ros1_bag(ROBOT, tmp_path / "a.bag", compression=compression)
    rosbag = str(shutil.which("rosbag"))
    command = [rosbag, "filter", tmp_path / "a.bag", tmp_path / "copy.bag", "True"]
    subprocess.run(command, capture_output=True, check=True)  # noqa: S603 - a fixed command
    _, copied = messages(tmp_path / "copy.bag", ros1=True)
    assert {topic: len(found) for topic, found in copied.items()} == {
        "/base_scan": 80,
        "/base_odometry/odom": 201,
        "/tf": 242,
    }
    np.testing.assert_array_equal(copied["/base_scan"][-1][1].ranges.argmin(), ROBOT.readings[-1].scan.ranges.argmin())


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
