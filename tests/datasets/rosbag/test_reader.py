"""Real bags, ROS 1 and ROS 2, with the oddities of real recordings."""

import json
import logging
import math

import numpy as np
import pytest

from datasets import DatasetError, open_recording
from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2
from tests.datasets.rosbag.ordinary_bag import ROLLED_OVER, STAMPS, assert_close, ordinary, read


@pytest.mark.parametrize("kind", ["none", "bz2", "lz4", "sqlite3", "mcap"])
def test_every_storage_gives_the_same_readings(script, expected_pose, tmp_path, kind):
    readings, recording = read(ordinary(script).write(tmp_path / "run.bag", kind))
    assert len(readings) == 60 == recording.expected_scans == recording.counts.scans_used
    for reading, stamp in zip(readings, STAMPS, strict=True):
        assert reading.scan.stamp == pytest.approx(stamp, abs=1e-6)
        assert_close(reading.T_odom_robot, expected_pose(stamp), 1e-4)
        assert reading.T_robot_sensor == pytest.approx(SE2(0.3, 0.0, 0.0))
    assert readings[0].scan.ranges.dtype == np.float64
    assert readings[0].scan.ranges.flags.writeable
    assert json.loads(json.dumps(recording.description))["odom_frame"] == "odom"
    assert recording.description["cloud_opening"] is None


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_ros2_storage_file_and_directory_without_metadata(script, tmp_path, kind):
    bag = ordinary(script).write(tmp_path / "run", kind)
    (bag / "metadata.yaml").unlink()
    storage = next(bag.iterdir())
    assert len(read(storage)[0]) == 60
    assert len(read(bag)[0]) == 60


def test_a_recording_can_be_read_again(script, tmp_path):
    recording = open_recording([ordinary(script).write(tmp_path / "run.bag")])
    first, counts = list(recording), recording.counts.as_dict()
    second = list(recording)
    assert [r.T_odom_robot for r in first] == [r.T_odom_robot for r in second]
    assert recording.counts.as_dict() == counts


@pytest.mark.parametrize(
    "mounting",
    [
        SE3.from_planar(SE2(-0.1, 0.0, math.pi)),
        SE3.from_planar(SE2(0.2, -0.3, 0.7)),
        SE3(0.1, 0.05, 0.4, 1.0, 0.0, 0.0, 0.0),
        SE3.from_planar(SE2(0.2, 0.1, 2.0)) @ ROLLED_OVER,
        SE3(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0),
    ],
    ids=["backwards", "off-centre", "upside-down", "upside-down-turned", "pitched-over"],
)
@pytest.mark.parametrize("topic", ["/tf", "/tf_static"])
def test_a_landmark_is_found_wherever_the_laser_sits(script, tmp_path, mounting, topic):
    landmark = SE3(2.0, 1.0, mounting.z, 0.0, 0.0, 0.0, 1.0)
    seen = mounting.inverse() @ landmark
    distance, bearing = math.hypot(seen.x, seen.y), math.atan2(seen.y, seen.x)
    for stamp in [100.0] if topic == "/tf_static" else np.arange(100.0, 103.0, 0.1):
        script.tf(float(stamp), "base_link", "laser", mounting, topic=topic)
    script.drive(100.0, 103.0)
    for k in range(20):
        script.scan(100.5 + 0.1 * k, [distance, np.nan], angle_min=bearing, step=0.01)
    readings, _ = read(script.in_time_order().write(tmp_path / "run.bag"))
    for reading in readings:
        points = reading.T_robot_sensor.apply(reading.scan.hit_points())
        assert points == pytest.approx(np.array([[2.0, 1.0]]), abs=1e-5)


def test_upside_down_reverses_the_beams(script, tmp_path):
    script.tf(100.0, "base_link", "laser", ROLLED_OVER, topic="/tf_static").drive(100.0, 103.0)
    bag = script.scan(101.0, angle_min=-0.4, step=0.1).in_time_order().write(tmp_path / "run.bag")
    scan = read(bag)[0][0].scan
    assert (scan.angle_min, scan.angle_increment) == pytest.approx((0.4, -0.1))
    scan = read(bag, upside_down=False)[0][0].scan
    assert (scan.angle_min, scan.angle_increment) == pytest.approx((-0.4, 0.1))


def test_a_laser_on_its_side_is_refused(script, tmp_path):
    lying = SE3(0.0, 0.0, 0.0, math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    script.tf(100.0, "base_link", "laser", lying, topic="/tf_static").drive(100.0, 103.0).scan(101.0)
    with pytest.raises(
        DatasetError, match=r"\.bag: the laser in frame laser scans 90 degrees off the horizontal.*--scan-topic"
    ):
        read(script.in_time_order().write(tmp_path / "run.bag"))


def test_moving_and_static_edges_in_any_order(script, expected_pose, tmp_path):
    script.tf(100.0, "base_footprint", "base_link", SE3(0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0), topic="/tf_static")
    script.tf(100.0, "laser", "mast", SE2(-0.3, 0.0, 0.0), topic="/tf_static")  # the laser above its carrier
    for stamp in np.arange(100.0, 104.0, 0.05):
        script.tf(float(stamp), "odom", "base_footprint", expected_pose(float(stamp)))
        script.tf(float(stamp), "base_link", "mast", SE2(0.1, 0.0, 0.0))
        script.tf(float(stamp), "map", "odom", SE2(7.0 * stamp, 3.0, 1.0))
    script.scan(102.02)
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert_close(readings[0].T_odom_robot, expected_pose(102.02))
    assert readings[0].T_robot_sensor == pytest.approx(SE2(0.4, 0.0, 0.0))
    assert recording.description["robot_frame"] == "base_footprint"
    assert recording.description["odom_frame"] == "odom"


@pytest.mark.parametrize("msgtype", ["tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"])
def test_leading_slashes_and_both_tf_messages(script, expected_pose, tmp_path, msgtype):
    for k, stamp in enumerate(np.arange(100.0, 104.0, 0.05)):
        slash = "/" if k % 2 else ""
        pose = expected_pose(float(stamp))
        script.tf(float(stamp), f"{slash}odom_combined", f"/{'base_link'}", pose, msgtype=msgtype)
        script.tf(float(stamp), "/base_link", "laser", SE2(0.2, 0.0, 0.0), msgtype=msgtype)
    script.scan(102.0, frame="/laser")
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert_close(readings[0].T_odom_robot, expected_pose(102.0))
    assert recording.description["odom_frame"] == "odom_combined"


def test_static_transforms_may_come_late(script, tmp_path):
    script.drive(100.0, 190.0, 0.1)
    for k in range(800):
        script.scan(100.5 + 0.1 * k, [1.0, 2.0 + 0.001 * k])
    script.tf(185.0, "base_link", "laser", SE2(0.3, 0.1, 0.0), topic="/tf_static")
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert len(readings) == 800 == recording.counts.scans_used
    assert readings[0].T_robot_sensor == pytest.approx(SE2(0.3, 0.1, 0.0))


def test_odometry_from_a_topic(script, expected_pose, tmp_path):
    script.tf(100.0, "base_link", "laser", SE2(0.3, 0.0, 0.0), topic="/tf_static")
    for stamp in np.arange(100.0, 104.0, 0.05):
        script.odometry(float(stamp), expected_pose(float(stamp)), topic="/vesc/odom")
    bag = script.scan(102.02).in_time_order().write(tmp_path / "run.bag")
    readings, recording = read(bag)
    assert_close(readings[0].T_odom_robot, expected_pose(102.02))
    assert readings[0].T_robot_sensor == pytest.approx(SE2(0.3, 0.0, 0.0))
    assert (recording.description["odometry"], recording.description["odometry_topic"]) == ("topic", "/vesc/odom")
    reading = read(bag, sensor_pose=SE2(1.0, 2.0, 0.5))[0][0]
    assert reading.T_robot_sensor == SE2(1.0, 2.0, 0.5)
    assert read(bag, odometry="none")[0][0].T_odom_robot is None


def test_an_unknown_mount_causes_a_warning(script, tmp_path, caplog):
    bag = script.drive(100.0, 103.0).scan(101.0).in_time_order().write(tmp_path / "run.bag")
    readings, _ = read(bag)
    assert readings[0].T_robot_sensor == SE2.identity()
    assert "the default is the robot's centre: pass --sensor-pose" in caplog.text


def test_missing_odometry_is_reported_or_refused(script, tmp_path, caplog):
    for k in range(5):
        script.scan(100.0 + 0.1 * k, [1.0 + k, 2.0])
    bag = script.write(tmp_path / "run.bag")
    readings, _ = read(bag)
    assert [reading.T_odom_robot for reading in readings] == [None] * 5
    assert "neither tf nor a topic holds usable odometry" in caplog.text
    with pytest.raises(
        DatasetError, match=r"tf connects no odometry frame with the robot; it has no frames.*--odom-frame"
    ):
        read(bag, odometry="tf")
    with pytest.raises(DatasetError, match=r"no topic holds odometry: choose another source with --odometry"):
        read(bag, odometry="topic")


def test_profile_stata(script, expected_pose, tmp_path):
    for stamp in np.arange(100.0, 104.0, 0.05):
        script.tf(float(stamp), "/odom_combined", "/base_footprint", expected_pose(float(stamp)))
        script.tf(float(stamp), "/map", "/odom_combined", SE2(stamp, 0.0, 0.0))
        script.tf(float(stamp), "/odom", "/base_footprint2", SE2(0.0, stamp, 0.0))
    script.scan(102.0, topic="/base_scan", frame="base_laser_link").scan(102.0, topic="/tilt_scan", frame="tilt")
    bag = script.in_time_order().write(tmp_path / "run.bag")
    with pytest.raises(
        DatasetError, match=r"several LaserScan topics hold scans: /base_scan \(1 scan\), /tilt_scan \(1 scan\)"
    ):
        read(bag)
    readings, recording = read(bag, profile="stata")
    assert_close(readings[0].T_odom_robot, expected_pose(102.0))
    assert readings[0].T_robot_sensor == SE2(0.275, 0.0, 0.0)
    assert recording.description["scan_topic"] == "/base_scan"
    assert (recording.description["odom_frame"], recording.description["robot_frame"]) == (
        "odom_combined",
        "base_footprint",
    )


@pytest.mark.parametrize("profile", ["auto", "stata"])
@pytest.mark.parametrize("fault", [82.2, -40.0])
def test_a_clock_fault_is_found_and_corrected(script, expected_pose, tmp_path, caplog, profile, fault):
    script.tf(300.0, "base_footprint", "laser", SE2(0.2, 0.0, 0.0), topic="/tf_static")
    for stamp in np.arange(300.0, 320.0, 0.05):
        script.tf(float(stamp), "odom_combined", "base_footprint", expected_pose(float(stamp)))
    for k in range(150):
        now = 301.0 + 0.1 * k
        script.scan(now - fault, [1.0, 2.0 + 0.01 * k], topic="/base_scan", bag_time=now)
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"), profile=profile)
    assert len(readings) == 150
    for reading in readings:
        assert_close(reading.T_odom_robot, expected_pose(reading.scan.stamp + fault))
    assert recording.description["clock_offset_s"] == pytest.approx(fault, abs=1e-6)
    assert (f"lag {fault:.2f} s behind" if fault > 0.0 else f"are {-fault:.2f} s ahead of") in caplog.text
    assert "a clock fault, corrected" in caplog.text


def test_the_odometry_is_brought_to_metres(script, expected_pose, tmp_path):
    bag = ordinary(script).write(tmp_path / "run.bag")
    readings, recording = read(bag, odometry_scale=0.001)
    told = expected_pose(STAMPS[3])
    assert_close(readings[3].T_odom_robot, SE2(0.001 * told.x, 0.001 * told.y, told.theta))
    assert recording.description["odometry_scale"] == 0.001


def test_a_given_clock_offset_is_obeyed(script, expected_pose, tmp_path):
    bag = ordinary(script).write(tmp_path / "run.bag")
    readings, _ = read(bag, clock_offset=0.5)
    assert_close(readings[3].T_odom_robot, expected_pose(STAMPS[3] + 0.5))
    assert readings[3].scan.stamp == pytest.approx(STAMPS[3])


def test_an_uncorrected_wrong_clock_is_an_error(script, tmp_path):
    with pytest.raises(DatasetError, match=r"none of 60 scans can be used \(60 before_odometry\).*--clock-offset"):
        read(ordinary(script).write(tmp_path / "run.bag"), clock_offset=-82.2)


def test_a_jumping_clock_is_counted(script, tmp_path, caplog):
    bag = ordinary(script)
    bag.scan(103.0, [9.0], bag_time=106.4)
    _, recording = read(bag.write(tmp_path / "run.bag"))
    assert recording.counts.clock_disagreements == 1
    assert "stamps that jump" in caplog.text


def test_times_that_step_back_keep_the_order_of_writing(script, tmp_path):
    """A drive along x, whose clock steps back by 0.35 s every ten scans: x must still grow from scan to scan."""
    stamp = 100.0
    for k in range(100):
        stamp += 0.1 if k % 10 else -0.35
        script.scan(stamp, [1.0, 2.0 + 0.01 * k])
        script.tf(stamp, "odom", "base_link", SE2(0.1 * k, 0.0, 0.0))
    script.tf(100.0, "base_link", "laser", topic="/tf_static")
    readings, recording = read(script.write(tmp_path / "run.bag"))
    assert recording.counts.backward_stamps == 9
    assert [reading.T_odom_robot.x for reading in readings] == pytest.approx([0.1 * k for k in range(100)], abs=1e-9)


def test_backward_header_stamps_are_kept_in_order(script, expected_pose, tmp_path):
    stamps = [*STAMPS[:30], STAMPS[29] - 0.04, *STAMPS[30:]]
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 106.5)
    for k, stamp in enumerate(stamps):
        script.scan(stamp, [1.0, 2.0 + 0.01 * k], bag_time=100.2 + 0.1 * k)
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert [reading.scan.stamp for reading in readings] == pytest.approx(stamps)
    assert recording.counts.backward_stamps == 1
    for reading in readings:
        assert_close(reading.T_odom_robot, expected_pose(reading.scan.stamp))


def test_duplicates_gaps_and_beam_counts(script, tmp_path):
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 112.0)
    script.scan(101.0, [1.0, 2.0]).scan(101.0, [1.0, 2.0]).scan(101.0, [1.0, 2.5])
    script.scan(101.1, [1.0, 2.0, 3.0]).scan(109.1, [1.0, 2.0, 3.0]).scan(109.2, []).scan(109.3, [np.nan, 0.0])
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert [len(reading.scan.ranges) for reading in readings] == [2, 2, 3, 3]
    counts = recording.counts
    assert (counts.scans_read, counts.scans_used) == (7, 4)
    assert counts.dropped == {"duplicate": 1, "empty": 2}
    assert (counts.same_stamps, counts.gaps, counts.longest_gap_s) == (1, 1, pytest.approx(8.0))
    assert counts.beam_count_changes == 3


@pytest.mark.parametrize("no_return", ["free", "drop"])
def test_ranges_are_cleaned(script, tmp_path, no_return):
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 103.0)
    script.scan(101.0, [np.nan, np.inf, -np.inf, 0.0, -1.0, 0.05, 5.0, 30.0, 65.533, 7.0])
    readings, recording = read(
        script.in_time_order().write(tmp_path / "run.bag"), no_return=no_return, no_return_codes=(7.0,)
    )
    nothing = np.inf if no_return == "free" else np.nan
    expected = [np.nan, nothing, np.nan, np.nan, np.nan, np.nan, 5.0, nothing, nothing, nothing]
    np.testing.assert_array_equal(readings[0].scan.ranges, expected)
    assert recording.counts.beams == {"hit": 1, "nan": 1, "no_return": 4, "too_close": 3, "zero": 1}


def test_scans_before_the_odometry_are_dropped_and_those_after_it_do_without(script, expected_pose, tmp_path):
    script.tf(90.0, "base_link", "laser", topic="/tf_static")
    script.drive(100.0, 105.0)
    for k in range(100):
        script.scan(99.0 + 0.1 * k, [1.0, 2.0 + 0.01 * k])
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert recording.counts.dropped == {"before_odometry": 10}
    assert recording.counts.extrapolated == 2
    known = [reading for reading in readings if reading.T_odom_robot is not None]
    assert recording.counts.without_odometry == 100 - 10 - len(known)
    assert known[-1].scan.stamp == pytest.approx(105.1)
    assert_close(known[-1].T_odom_robot, expected_pose(105.1), 2e-2)


def test_odometry_is_not_interpolated_across_a_long_gap(script, tmp_path):
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 104.0).drive(150.0, 154.0)
    for stamp in (103.0, 120.0, 152.0):
        script.scan(stamp)
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert [reading.scan.stamp for reading in readings] == pytest.approx([103.0, 120.0, 152.0])
    assert [reading.T_odom_robot is None for reading in readings] == [False, True, False]
    assert recording.counts.without_odometry == 1
    assert recording.counts.gaps == 2


def test_stamps_left_at_zero_are_replaced_by_bag_time(script, expected_pose, tmp_path):
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 103.0)
    script.scan(0.0, bag_time=101.5)
    readings, _ = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert readings[0].scan.stamp == pytest.approx(101.5)
    assert_close(readings[0].T_odom_robot, expected_pose(101.5))


def test_the_angle_step_can_be_set(script, tmp_path, caplog):
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 103.0)
    script.scan(101.0, np.full(180, 2.0), angle_min=-math.pi / 2, step=math.pi / 179)
    bag = script.in_time_order().write(tmp_path / "run.bag")
    assert read(bag)[0][0].scan.angle_increment == pytest.approx(math.pi / 179)
    assert "pass --angle-step-deg 1" in caplog.text
    scan = read(bag, angle_step_deg=1.0)[0][0].scan
    assert scan.angle_increment == pytest.approx(math.radians(1.0))
    assert scan.angle_min == pytest.approx(-math.pi / 2)


def test_several_bags_are_one_recording(script, tmp_path):
    whole = ordinary(script).messages
    parts = []
    for k, (start, stop) in enumerate([(103.0, 200.0), (0.0, 103.0)]):
        part = type(script)([message for message in whole if start <= message[0] < stop])
        parts.append(part.write(tmp_path / f"part{k}.bag"))
    together = list(open_recording(parts))
    alone = list(open_recording([script.in_time_order().write(tmp_path / "whole.bag")]))
    assert [r.scan.stamp for r in together] == [r.scan.stamp for r in alone]
    assert [r.T_odom_robot for r in together] == [r.T_odom_robot for r in alone]


def test_counts_are_logged_nowhere_but_returned(script, tmp_path, capsys, caplog):
    with caplog.at_level(logging.DEBUG):
        _, recording = read(ordinary(script).write(tmp_path / "run.bag"))
    assert capsys.readouterr().out == ""
    assert recording.counts.summary().startswith("60 of 60 scans used; beams: 100.0 % hit")


def test_topics_in_blocks_of_their_own(script, tmp_path):
    bag = ordinary(script)
    bag.messages.sort(key=lambda message: message[1])
    assert len(read(bag.write(tmp_path / "run.bag", "bz2"))[0]) == 60


@pytest.mark.parametrize("source", ["tf", "topic"])
def test_stamps_that_a_simulation_leaves_at_zero_until_it_hears_its_clock(script, tmp_path, source):
    clocks = [20.0 + 0.1 * k if k >= 10 else 0.0 for k in range(80)]
    script.drive_of_a_late_clock(source, clocks, scan_delay=0.001)
    readings = list(open_recording([script.write(tmp_path / "run.bag")]))
    assert len(readings) == 80
    assert [reading.scan.stamp for reading in readings] == pytest.approx([20.0 + 0.1 * k for k in range(80)], abs=0.01)
    assert [r.T_odom_robot.x for r in readings] == pytest.approx([0.1 * k for k in range(80)], abs=0.01)
