"""Which topics are read, and what is said when that is not clear."""

import pytest

from datasets import DatasetError, RecordingOptions, open_recording
from tbmslam.se2 import SE2


def choose(path, **options):
    return open_recording([path], RecordingOptions(**options))


def test_several_scan_topics_are_listed(script, tmp_path):
    script.drive(100.0, 103.0).scan(101.0, topic="/front").scan(101.1, topic="/rear").scan(101.2, topic="/rear")
    bag = script.in_time_order().write(tmp_path / "run.bag")
    message = (
        r"run\.bag has several LaserScan topics: /front \(1 scans\), /rear \(2 scans\): choose one with --scan-topic"
    )
    with pytest.raises(DatasetError, match=message):
        choose(bag)
    assert choose(bag, scan_topic="rear").expected_scans == 2


def test_no_scan_topic(script, tmp_path):
    bag = script.odometry(100.0, SE2.identity()).tf(100.0, "odom", "base_link").write(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"run\.bag has no LaserScan topic; it has /odom, /tf: choose another"):
        choose(bag)


def test_wrong_topics(script, tmp_path):
    script.drive(100.0, 103.0).scan(101.0)
    bag = script.in_time_order().write(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"/tf is a tf2_msgs/msg/TFMessage, not a sensor_msgs/msg/LaserScan"):
        choose(bag, scan_topic="/tf")
    with pytest.raises(DatasetError, match=r"has no topic /nope; it has /scan: choose with --scan-topic"):
        choose(bag, scan_topic="/nope")
    with pytest.raises(
        DatasetError, match=r"has no topic /odom; it has none of its type: choose with --odometry-topic"
    ):
        choose(bag, odometry_topic="/odom")
    with pytest.raises(DatasetError, match=r"has no topic /tf2; it has /tf: choose with --tf-topic"):
        choose(bag, tf_topics=("/tf2",))


def test_a_topic_without_messages_is_an_error(script, tmp_path):
    from rosbags import rosbag1
    from rosbags.typesys import Stores, get_typestore

    with rosbag1.Writer(tmp_path / "run.bag") as writer:
        store = get_typestore(Stores.ROS1_NOETIC)
        writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store)
        other = writer.add_connection("/word", "std_msgs/msg/String", typestore=store)
        writer.write(other, 10**9, b"\1\0\0\0a")
    with pytest.raises(DatasetError, match=r"/scan holds no messages: there is nothing to map"):
        choose(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"/scan holds no messages: choose another with --scan-topic"):
        choose(tmp_path / "run.bag", scan_topic="scan")


def test_several_odometry_topics(script, tmp_path):
    for k in range(40):
        script.odometry(100.0 + 0.1 * k, SE2(1.0, 0.0, 0.0), topic="/a").odometry(
            100.0 + 0.1 * k, SE2(2.0, 0.0, 0.0), topic="/b"
        )
    bag = script.scan(101.0).in_time_order().write(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"several Odometry topics: /a, /b: choose one with --odometry-topic"):
        choose(bag, odometry="topic")
    assert next(iter(choose(bag, odometry_topic="b"))).T_odom_robot == pytest.approx(SE2(2.0, 0.0, 0.0))
