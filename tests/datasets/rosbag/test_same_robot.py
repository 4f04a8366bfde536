"""Several robots in one bag: whose transforms and whose odometry."""

import pytest

from datasets import RecordingOptions, open_recording
from datasets.rosbag.same_robot import is_plain_odom, nearness_to, of_same_robot
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
