"""What is read, and how the clocks of its messages are compared."""

import numpy as np
import pytest

from datasets import DatasetError, RecordingOptions, open_recording
from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2
from tests.datasets.conftest import BagScript
from tests.datasets.rosbag.ordinary_bag import read
from tests.warnings_page import is_explained


def test_odometry_of_a_slow_clock_is_read_by_the_time_it_came(script, tmp_path):
    """The topic's stamps are 80 s behind those of the scans."""
    for k in range(60):
        now = 100.0 + 0.1 * k
        script.odometry(now - 80.0, SE2(0.1 * k, 0.0, 0.0), bag_time=now)
        script.scan(now + 0.05, bag_time=now + 0.05)
    bag = script.in_time_order().write(tmp_path / "run.bag")
    readings = list(open_recording([bag], RecordingOptions(odometry="topic")))
    assert len(readings) > 50
    for reading in readings[:50]:
        x = reading.scan.stamp - 100.0
        assert reading.T_odom_robot == pytest.approx(SE2(x, 0.0, 0.0), abs=0.02)


def test_two_robots_on_one_topic_are_refused_in_one_line(script, tmp_path):
    random = np.random.default_rng(1)
    rooms = random.uniform(1.0, 9.0, (2, 180))
    script.drive(100.0, 108.0)
    for k in range(60):
        script.scan(100.5 + 0.1 * k, rooms[k % 2] + random.normal(0.0, 0.01, 180), step=0.02)
    bag = script.in_time_order().write(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"run\.bag: two lasers or robots share /scan, their scans alternate"):
        open_recording([bag])


@pytest.mark.parametrize(
    ("others_lag", "offset"), [(None, 60.04), (0.04, 60.0), (60.04, 60.04)], ids=["alone", "right", "as wrong"]
)
def test_the_delay_of_scans_is_measured_by_a_laser_with_a_correct_clock(script, tmp_path, others_lag, offset):
    script.drive(100.0, 108.0)
    for k in range(60):
        now = 100.5 + 0.1 * k
        script.scan(now - 60.0, [1.0, 2.0, 3.0 + 0.01 * k], bag_time=now + 0.04)
        if others_lag is not None:
            script.scan(now + 0.04 - others_lag, topic="/rear", frame="rear", bag_time=now + 0.04)
    bag = script.in_time_order().write(tmp_path / "run.bag")
    recording = open_recording([bag], RecordingOptions(scan_topic="/scan"))
    assert recording.description["clock_offset_s"] == pytest.approx(offset, abs=1e-3)


def test_a_second_laser_on_the_same_topic_is_left_out(script, tmp_path):
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 103.0)
    script.scan(101.0, frame="laser").scan(101.1, [4.0], frame="rear").scan(101.2, [5.0], frame="/laser")
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert len(readings) == 2
    assert recording.counts.dropped == {"other_frame": 1}


def two_lasers(script):
    script.tf(99.0, "base_link", "front", topic="/tf_static").drive(100.0, 110.0)
    for number in range(90):
        stamp = 100.5 + 0.1 * number
        script.scan(stamp, [np.inf] * 3, frame="blind").scan(
            stamp + 0.05, [1.0, 2.0, 3.0 + 0.01 * number], frame="front"
        )
    return script.in_time_order()


def test_the_laser_that_sees_something_is_taken(script, tmp_path, caplog):
    caplog.set_level("WARNING")
    readings, recording = read(two_lasers(script).write(tmp_path / "run.bag"))
    assert len(readings) == 90
    assert recording.description["sensor_frame"] == "front"
    assert recording.counts.dropped == {"other_frame": 90}
    chosen = next(record.getMessage() for record in caplog.records if "--laser-frame" in record.getMessage())
    assert "/scan holds scans of several lasers: blind (0 of 41 at the beginning hold hits), front (40 of 40" in chosen
    assert chosen.endswith("front is used: pass --laser-frame for another")
    assert "90 scans of lasers other than front are ignored" in caplog.text


def test_the_laser_that_is_asked_for_is_taken(script, tmp_path, caplog):
    script.tf(99.0, "base_link", "late", topic="/tf_static").drive(100.0, 110.0)
    for number in range(90):  # the other one comes after what the survey mostly reads
        script.scan(100.5 + 0.1 * number, [1.0, 2.0 + 0.01 * number], frame="late" if number > 80 else "laser")
    path = script.in_time_order().write(tmp_path / "run.bag")
    readings, recording = read(path, laser_frame="late")
    assert len(readings) == 9
    assert recording.description["sensor_frame"] == "late"
    assert "81 scans of lasers other than late are ignored" in caplog.text
    assert "pass --laser-frame" not in caplog.text
    caplog.clear()
    assert read(path)[1].counts.dropped == {"other_frame": 9}
    assert "9 scans of lasers other than laser are ignored" in caplog.text


def test_a_laser_that_is_not_there_is_one_line_with_those_that_are(script, tmp_path):
    path = two_lasers(script).write(tmp_path / "run.bag")
    with pytest.raises(DatasetError) as caught:
        open_recording([path], RecordingOptions(laser_frame="rear"))
    assert str(caught.value) == (
        f"{path}: no scan of /scan has the frame rear; there are blind (90 scans), front (90 scans): "
        "choose one with --laser-frame"
    )


@pytest.mark.parametrize(("away", "refused"), [(30.0, False), (1e6, True), (1e300, False)])
def test_a_laser_far_from_its_robot(script, tmp_path, caplog, away, refused):
    script.tf(99.0, "base_link", "laser", SE2(away, 0.0, 0.0), topic="/tf_static").drive(100.0, 103.0).scan(101.0)
    path = script.write(tmp_path / "run.bag")
    if refused:
        with pytest.raises(DatasetError, match=r"\.bag: in tf the laser is mounted 1e\+06 m from .*pass --sensor-pose"):
            open_recording([path])
    else:
        _, recording = read(path)
        # A place that is not on earth is no transform at all.
        far = "the laser is mounted 30 m from the robot's centre" in caplog.text
        assert far is (away == 30.0) is bool(recording.description["frame_warnings"])
        assert all(map(is_explained, recording.description["frame_warnings"]))
        assert recording.description["sensor_pose_known"] is far


@pytest.mark.parametrize("by_tf", [True, False])
@pytest.mark.parametrize("frame", ["odom", "map"])
def test_points_in_the_frame_of_the_drive_are_refused(script, tmp_path, by_tf, frame):
    if frame == "map":
        script.tf(99.0, "map", "odom").tf(105.0, "map", "odom", SE2(0.1, 0.0, 0.0))
    for k in range(60):
        now = 100.0 + 0.1 * k
        if by_tf:
            script.tf(now, "odom", "base_link", SE2(0.1 * k, 0.0, 0.0))
        else:
            script.odometry(now, SE2(0.1 * k, 0.0, 0.0))
        script.scan(now + 0.05, frame=frame)
    path = script.in_time_order().write(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=f"the points of /scan are in the frame {frame}, in which the robot moves"):
        open_recording([path])
    assert len(read(path, sensor_pose=SE2.identity())[0]) > 50


@pytest.mark.parametrize(
    ("edge", "header", "child", "frame"),
    [
        (("base_link", "odom"), None, "", "base_link"),
        (None, "base_link", "odom", "base_link"),
        (None, "base_link", "", "base_link"),
        (None, "/robot", "robot", "robot"),
        (("odom", "base_link"), "base_link", "odom", "base_link"),
    ],
    ids=["tf upside down", "topic upside down", "no child", "both the robot", "beside good tf"],
)
def test_frames_of_odometry_that_are_stated_wrongly_do_no_harm(script, tmp_path, edge, header, child, frame):
    for k in range(60):
        now, pose = 100.0 + 0.1 * k, SE2(0.1 * k, 0.0, 0.0)
        if edge is not None:
            script.tf(now, *edge, pose if edge[0] == "odom" else pose.inverse())
        if header is not None:
            script.odometry(now, pose, frame=header, child=child)
        script.scan(now + 0.05, frame=frame)
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert recording.description["odometry"] == ("tf" if edge else "topic")
    assert readings[-1].T_odom_robot == pytest.approx(SE2(5.9, 0.0, 0.0), abs=0.1)


def test_scans_without_beams_are_refused_in_one_line(script, tmp_path):
    for k in range(90):
        script.scan(100.0 + 0.05 * k, [])
    path = script.write(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"none of 90 scans can be used \(90 empty\)"):
        list(open_recording([path]))


def test_a_stated_odometry_frame_that_is_missing_is_an_error(script, tmp_path):
    path = script.drive(100.0, 103.0).scan(101.0).write(tmp_path / "run.bag")
    with pytest.raises(
        DatasetError, match=r"does not connect the frame odm with .*; it has base_link, odom: pass --odom"
    ):
        open_recording([path], RecordingOptions(odom_frame="odm"))
    assert open_recording([path], RecordingOptions(odom_frame="odom")).description["odometry"] == "tf"
    assert (
        open_recording([path], RecordingOptions(profile="stata", scan_topic="/scan")).description["odometry"] == "none"
    )


@pytest.mark.parametrize(("stamp", "warned"), [(0.0, True), (101.0, False)])
def test_scans_without_stamps_cause_a_warning(script, tmp_path, caplog, stamp, warned):
    path = script.drive(100.0, 103.0).scan(stamp, bag_time=101.0).in_time_order().write(tmp_path / "run.bag")
    warning = open_recording([path]).description["clock_warning"]
    assert (warning is not None and "have no stamps" in warning) is warned
    assert ("the scans have no stamps (all are zero)" in caplog.text) is warned


@pytest.mark.parametrize(
    ("limits", "options", "warned"),
    [
        ((30.0, 0.1), {}, True),
        ((30.0, 0.1), {"range_min": 0.1, "range_max": 30.0}, False),
        ((0.1, 30.0), {}, False),
        ((0.0, 0.0), {}, False),
    ],
)
def test_contradictory_limits_of_the_ranges_cause_a_warning(script, tmp_path, limits, options, warned):
    path = script.drive(100.0, 103.0).scan(101.0, limits=limits).in_time_order().write(tmp_path / "run.bag")
    warnings = open_recording([path], RecordingOptions(**options)).description["frame_warnings"]
    assert any("from 30 to 0.1 m; these limits contradict each other" in line for line in warnings) is warned


@pytest.mark.parametrize(("pause", "warned"), [(5.0, False), (86400.0, True)])
def test_a_long_pause_between_two_files_causes_a_warning(tmp_path, caplog, pause, warned):
    paths = []
    for name, start in (("tuesday", 103.0 + pause), ("monday", 100.0)):
        script = BagScript().drive(start, start + 3.0).scan(start + 1.0)
        paths.append(script.in_time_order().write(tmp_path / f"{name}.bag"))
    open_recording(paths)
    told = f"{paths[0]} begins 86400 s after the end of {paths[1]}: if they are two drives, pass --separate"
    assert (told in caplog.text) is warned


def camera(script, *, mount=None):
    """Write what a level camera sees of a wall 3 m ahead: x to the right, y down, z ahead."""
    across, down = (each.ravel() for each in np.meshgrid(np.linspace(-2.0, 2.0, 300), np.linspace(-1.0, 0.4, 15)))
    points = np.column_stack((across, down, np.full(len(down), 3.0)))
    if mount is not None:
        script.tf(99.0, "base_link", "camera_optical", mount, topic="/tf_static")
    for k in range(60):
        script.cloud(100.1 + 0.1 * k, points + 1e-3 * k, frame="camera_optical")
    return script.drive(100.0, 107.0).in_time_order()


def test_a_camera_whose_mount_is_unknown_is_refused(script, tmp_path):
    path = camera(script).write(tmp_path / "run.bag")
    for heights in (None, (0.9, 4.5)):
        with pytest.raises(DatasetError) as caught:
            open_recording([path], RecordingOptions(cloud_heights=heights))
        assert str(caught.value) == (
            f"{path}: tf lacks the mount of camera_optical, the frame of /points, so the heights of its points are "
            "unknown: record tf and tf_static, or pass --sensor-pose X Y DEG if the camera is level and looks in this "
            "direction"
        )


@pytest.mark.parametrize("mount", [None, SE3(0.2, 0.0, 0.4, -0.5, 0.5, -0.5, 0.5)])
def test_a_camera_sees_what_is_ahead_of_it(script, tmp_path, mount):
    path = camera(script, mount=mount).write(tmp_path / "run.bag")
    readings, _ = read(path, **({} if mount else {"sensor_pose": SE2(0.2, 0.0, 0.0)}))
    scan = readings[0].scan
    points = readings[0].T_robot_sensor.apply(scan.hit_points())
    assert len(points) > 40
    np.testing.assert_allclose(points[:, 0], 3.2, atol=0.02)
    assert -2.1 < points[:, 1].min() < -1.8 < 1.8 < points[:, 1].max() < 2.1


@pytest.mark.parametrize("source", ["tf", "topic"])
def test_one_clock_is_used_where_a_simulation_starts_its_clock_late(script, tmp_path, caplog, source):
    """The clock starts after what the survey mostly reads, and odometry arrives sooner than scans."""
    clocks = [0.1 * (k - 199) if k >= 200 else 0.0 for k in range(300)]
    script.drive_of_a_late_clock(source, clocks, scan_delay=0.03)
    readings, recording = read(script.in_time_order().write(tmp_path / "run.bag"))
    assert [reading.scan.stamp for reading in readings] == pytest.approx([0.1 * (k - 199) for k in range(300)])
    assert [reading.T_odom_robot.x for reading in readings] == pytest.approx([0.1 * k for k in range(300)])
    (warning,) = (each for each in recording.description["frame_warnings"] if "stamps" in each)
    assert warning == (
        "the first 200 scans have no stamps (zero): the times of their recording are used, by the clock of the later "
        "stamps"
    )
    assert is_explained(warning)
    assert warning in caplog.text
    assert "all are zero" not in caplog.text
    assert recording.counts.clock_disagreements == 0


def test_of_a_long_recording_without_stamps_only_the_beginning_is_surveyed(script, tmp_path, caplog):
    for k in range(330):
        script.scan(0.0, (1.0, 2.0, 3.0 + 0.01 * k), bag_time=1000.0 + k)
    path = script.write(tmp_path / "run.bag")
    warning = open_recording([path]).description["clock_warning"]
    fact = "scans have no stamps (all are zero), so the times of their recording are used"
    assert warning == f"the first 302 {fact}"  # no more is known yet
    assert is_explained(warning)
    assert warning in caplog.text
