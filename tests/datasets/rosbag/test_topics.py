"""Which topics are read, and what is said when that is not clear."""

import math

import numpy as np
import pytest

from datasets import DatasetError, RecordingOptions, open_recording
from datasets.rosbag.topics import is_plain_odom, nearness_to, of_same_robot
from tbmslam.geometry.se2 import SE2


def test_what_lies_nearer_to_other_scans_is_another_robots():
    names = ["/robot_1/tf", "/robot_2/tf", "/tf"]
    assert of_same_robot(names, "/robot_2/scan", ["/robot_1/scan"]) == ["/robot_2/tf", "/tf"]
    assert of_same_robot(names, "/robot_1/scan", ["/robot_2/scan"]) == ["/robot_1/tf", "/tf"]
    assert of_same_robot(["/robot_1/odom"], "/robot_2/scan", ["/robot_1/scan"]) == []
    assert of_same_robot(names, "/robot_1/scan", []) == names  # one robot: nothing says that any is not its own


def test_a_robot_without_a_namespace_beside_one_with():
    names = ["/odom", "/robot_2/odom"]
    assert of_same_robot(names, "/scan", ["/robot_2/scan"]) == ["/odom"]
    assert of_same_robot(names, "/robot_2/scan", ["/scan"]) == ["/robot_2/odom"]
    assert of_same_robot(["/odom"], "/robot_2/scan", ["/scan"]) == ["/odom"]


def test_two_lasers_of_one_robot_share_all():
    names = ["/robot/odom", "/robot/wheels/odom", "/tf"]
    assert of_same_robot(names, "/robot/front/scan", ["/robot/rear/scan"]) == names
    assert of_same_robot(["/odom"], "/front/scan", ["/rear/scan"]) == ["/odom"]


def test_names_that_are_shared():
    nearness = nearness_to("/site/robot_1/scan")
    assert [nearness(name) for name in ("/odom", "/site/odom", "site/robot_1/odom", "/robot_1/odom")] == [0, 1, 2, 0]
    plain = ("/odom", "/site/odom", "/site/robot_1/odom")
    assert all(is_plain_odom(name, "/site/robot_1/scan") for name in plain)
    assert not is_plain_odom("/wheels/odom", "/scan")
    assert not is_plain_odom("/robot_1/odometry", "/robot_1/scan")


@pytest.mark.parametrize("source", ["tf", "topic"])
@pytest.mark.parametrize("robot", [1, 2])
def test_each_robots_scans_meet_its_own_odometry(script, tmp_path, source, robot):
    """Frames have the same names on both robots, as where each has transforms in its own namespace."""
    for k in range(60):
        stamp = 100.0 + 0.1 * k
        for number in (1, 2):
            pose = SE2(10.0 * number, 0.0, 0.0)
            if source == "tf":
                script.tf(stamp, "odom", "base_link", pose, topic=f"/robot_{number}/tf")
            else:
                script.odometry(stamp, pose, topic=f"/robot_{number}/odom")
            script.scan(stamp + 0.01, (1.0, 2.0, 3.0 + k), topic=f"/robot_{number}/scan")
    for number in (1, 2):
        mount = SE2(0.1 * number, 0.0, 0.0)
        script.tf(100.0, "base_link", "laser", mount, topic=f"/robot_{number}/tf_static", bag_time=99.0)
    bag = script.in_time_order().write(tmp_path / "both.bag")
    reading = next(iter(open_recording([bag], RecordingOptions(scan_topic=f"/robot_{robot}/scan"))))
    assert reading.T_odom_robot == pytest.approx(SE2(10.0 * robot, 0.0, 0.0))
    assert reading.T_robot_sensor == pytest.approx(SE2(0.1 * robot, 0.0, 0.0))


def choose(path, **options):
    return open_recording([path], RecordingOptions(**options))


def test_several_scan_topics_are_listed(script, tmp_path):
    script.drive(100.0, 103.0).scan(101.0, topic="/front").scan(101.1, topic="/rear").scan(101.2, topic="/rear")
    bag = script.in_time_order().write(tmp_path / "run.bag")
    topics = r"/front \(1 scan\), /rear \(2 scans\)"
    message = rf"run\.bag: several LaserScan topics hold scans: {topics}: choose one with --scan-topic"
    with pytest.raises(DatasetError, match=message):
        choose(bag)
    assert choose(bag, scan_topic="rear").expected_scans == 2


def test_no_scan_topic(script, tmp_path):
    bag = script.odometry(100.0, SE2.identity()).tf(100.0, "odom", "base_link").write(tmp_path / "run.bag")
    with pytest.raises(
        DatasetError, match=r"run\.bag: no topic is a LaserScan or PointCloud2; there are /odom, /tf: choose another"
    ):
        choose(bag)


LIDAR_TYPES = [
    *("velodyne_msgs/msg/VelodyneScan", "pandar_msgs/msg/PandarScan", "hesai_ros_driver/msg/UdpFrame"),
    *("nebula_msgs/msg/NebulaPackets", "ouster_ros/msg/PacketMsg", "ouster_sensor_msgs/msg/PacketMsg"),
    *("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg", "rslidar_msg/msg/RslidarPacket"),
    *("robosense_msgs/msg/RobosenseScan", "lslidar_msgs/msg/LslidarPacket"),
]


@pytest.mark.parametrize("has_empty_topic", [False, True])
@pytest.mark.parametrize("msgtype", LIDAR_TYPES)
def test_data_that_only_the_driver_of_a_lidar_reads(msgtype, has_empty_topic, tmp_path):
    from rosbags import rosbag1
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("uint8[] data\n", msgtype))
    with rosbag1.Writer(tmp_path / "run.bag") as writer:
        word = writer.add_connection("/word", "std_msgs/msg/String", typestore=store)
        writer.add_connection("/silent", msgtype, typestore=store)
        if has_empty_topic:
            writer.add_connection("/points", "sensor_msgs/msg/PointCloud2", typestore=store)
        writer.write(word, 10**9, b"\1\0\0\0a")
        packets = writer.add_connection("/packets", msgtype, typestore=store)
        writer.write(packets, 10**9, b"\1\0\0\0a")
    data = rf"; /packets \({msgtype}\) holds a lidar's own data: convert packets to PointCloud2 with the lidar's driver"
    fact = "/points holds no messages" if has_empty_topic else "no topic is a LaserScan or PointCloud2"
    with pytest.raises(DatasetError, match=fact + data):
        choose(tmp_path / "run.bag")


def test_wrong_topics(script, tmp_path):
    script.drive(100.0, 103.0).scan(101.0)
    bag = script.in_time_order().write(tmp_path / "run.bag")
    with pytest.raises(
        DatasetError, match=r"/tf is a tf2_msgs/msg/TFMessage, not a sensor_msgs/msg/LaserScan or sensor_msgs/msg/Multi"
    ):
        choose(bag, scan_topic="/tf")
    with pytest.raises(DatasetError, match=r"there is no topic /nope; there is /scan: choose with --scan-topic"):
        choose(bag, scan_topic="/nope")
    with pytest.raises(
        DatasetError,
        match=r"there is no topic /odom; there is no topic of a fitting type: choose with --odometry-topic",
    ):
        choose(bag, odometry_topic="/odom")
    with pytest.raises(DatasetError, match=r"there is no topic /tf2; there is /tf: choose with --tf-topic"):
        choose(bag, tf_topics=("/tf2",))


def test_a_topic_without_messages_is_an_error(script, tmp_path):
    from rosbags import rosbag1
    from rosbags.typesys import Stores, get_typestore

    with rosbag1.Writer(tmp_path / "run.bag") as writer:
        store = get_typestore(Stores.ROS1_NOETIC)
        writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store)
        other = writer.add_connection("/word", "std_msgs/msg/String", typestore=store)
        writer.write(other, 10**9, b"\1\0\0\0a")
    with pytest.raises(DatasetError, match=r"/scan holds no messages: give another recording"):
        choose(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"/scan holds no messages: choose another with --scan-topic"):
        choose(tmp_path / "run.bag", scan_topic="scan")


def test_several_odometry_topics(script, tmp_path):
    for k in range(40):
        script.odometry(100.0 + 0.1 * k, SE2(1.0, 0.0, 0.0), topic="/a").odometry(
            100.0 + 0.1 * k, SE2(2.0, 0.0, 0.0), topic="/b"
        )
    bag = script.scan(101.0).in_time_order().write(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"several topics hold odometry: /a, /b: choose one with --odometry-topic"):
        choose(bag, odometry="topic")
    assert next(iter(choose(bag, odometry_topic="b"))).T_odom_robot == pytest.approx(SE2(2.0, 0.0, 0.0))


def with_echoes(script, stamp, topic="/echoes", number=1):
    def build(types):
        return types["sensor_msgs/msg/MultiEchoLaserScan"](
            header=types["std_msgs/msg/Header"](
                stamp=types["builtin_interfaces/msg/Time"](int(stamp), round(stamp % 1 * 1e9)), frame_id="laser"
            ),
            angle_min=-0.5,
            angle_max=0.5,
            angle_increment=0.5,
            time_increment=0.0,
            scan_time=0.1,
            range_min=0.1,
            range_max=30.0,
            ranges=[
                types["sensor_msgs/msg/LaserEcho"](np.array(echoes, np.float32))
                for echoes in ([number, 7.0], [], [2.0])
            ],
            intensities=[],
        )

    script.messages.append((stamp, topic, "sensor_msgs/msg/MultiEchoLaserScan", build))


def test_of_several_echoes_the_first_is_read(script, tmp_path):
    for k in range(30):
        script.odometry(100.0 + 0.1 * k, SE2(0.1 * k, 0.0, 0.0))
        with_echoes(script, 100.0 + 0.1 * k, number=1.0 + k)
    readings = list(choose(script.write(tmp_path / "echoes", "sqlite3")))
    assert len(readings) == 30
    assert readings[3].scan.ranges == pytest.approx([4.0, math.nan, 2.0], nan_ok=True)


def test_scans_go_before_echoes_that_are_asked_for_by_name(script, tmp_path):
    for k in range(30):
        script.odometry(100.0 + 0.1 * k, SE2(0.1 * k, 0.0, 0.0)).scan(100.0 + 0.1 * k, (1.0, 5.0, 1.0 + k))
        with_echoes(script, 100.0 + 0.1 * k, "/echoes", 1.0 + k)
    bag = script.write(tmp_path / "both", "mcap")
    assert next(iter(choose(bag))).scan.ranges[1] == pytest.approx(5.0)
    assert math.isnan(next(iter(choose(bag, scan_topic="/echoes"))).scan.ranges[1])


def test_several_topics_of_echoes_are_listed(script, tmp_path):
    with_echoes(script, 100.0, "/horizontal")
    with_echoes(script, 100.1, "/vertical")
    bag = script.write(tmp_path / "echoes", "sqlite3")
    with pytest.raises(
        DatasetError, match=r"several MultiEchoLaserScan topics hold scans: /horizontal \(1 scan\), /vertical"
    ):
        choose(bag)


def test_clouds_are_taken_where_there_are_no_scans(script, tmp_path):
    def build(types):
        header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 0), "lidar")
        return types["sensor_msgs/msg/PointCloud2"](header, 1, 0, [], False, 12, 0, np.zeros(0, np.uint8), True)

    script.messages.append((1.0, "/points", "sensor_msgs/msg/PointCloud2", build))
    bag = script.write(tmp_path / "cloud", "mcap")
    with pytest.raises(
        DatasetError, match="no cloud of /points holds readable x, y and z: choose another --scan-topic"
    ):
        choose(bag)


def test_odometry_without_motion_is_reported_and_not_awaited(script, tmp_path, caplog):
    def nowhere(build):
        def built(types):
            message = build(types)
            message.pose.pose.orientation.w = message.pose.pose.orientation.z = 0.0
            return message

        return built

    for k in range(60):
        script.odometry(100.0 + 0.1 * k, SE2.identity()).scan(100.0 + 0.1 * k, (1.0, 2.0, 1.0 + k))
    script.messages = [
        (time, topic, kind, nowhere(build) if topic == "/odom" else build)
        for time, topic, kind, build in script.messages
    ]
    bag = script.write(tmp_path / "run.bag")
    readings = list(choose(bag))
    assert len(readings) == 60
    assert {reading.T_odom_robot for reading in readings} == {None}
    assert "/odom holds no valid poses (quaternions of zeros, or not a number); continuing without" in caplog.text
    with pytest.raises(
        DatasetError, match=r"/odom holds no valid poses .*: choose another with --odometry-topic, or pass --od"
    ):
        choose(bag, odometry="topic")


def test_ranges_in_millimetres_are_refused(script, tmp_path):
    random = np.random.default_rng(0)
    for k in range(60):
        script.scan(100.0 + 0.1 * k, 1000.0 * random.uniform(0.4, 8.0, 40), limits=(20.0, 30000.0))
    message = r"nine of ten ranges of /scan are beyond \d{3,4} m, perhaps in millimetres: record them in metres, or"
    with pytest.raises(DatasetError, match=message):
        choose(script.write(tmp_path / "run.bag"))


def test_codes_alone_are_no_millimetres(script, tmp_path):
    for k in range(60):
        script.scan(100.0 + 0.1 * k, [65533.0, 65535.0] * 10 + [3.0 + 0.01 * k])
    assert len(list(choose(script.write(tmp_path / "run.bag")))) == 60
