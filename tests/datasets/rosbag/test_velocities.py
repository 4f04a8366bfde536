"""Odometry of velocities without poses."""

import pytest

from datasets import DatasetError, RecordingOptions, open_recording
from tbmslam.geometry.se2 import SE2
from tests.datasets.rosbag.ordinary_bag import read
from tests.warnings_page import is_explained

HOME = SE2(0.0, 0.0, 0.0)


def drive(script, speed, seconds=8.0, starts=0.0, tf=None):
    """Write scans, and odometry whose poses follow its speed from some time on; `tf` adds a constant transform."""
    for k in range(round(20 * seconds)):
        after = 0.05 * k
        pose = SE2(speed[0] * (after - starts), 0.0, 0.0) if after >= starts else HOME
        script.odometry(100.0 + after, pose, speed=speed)
        if tf is not None:
            script.tf(100.0 + after, "odom", "base_link", tf)
        if k % 2:
            script.scan(100.0 + after, [1.0, 2.0, 3.0 + 0.01 * k], bag_time=100.0 + after + 0.001)
    return script.in_time_order()


@pytest.mark.parametrize("kind", ["none", "mcap"])
@pytest.mark.parametrize("speed", [(0.5, 0.0), (-0.5, 0.0), (0.0, 0.3)])
@pytest.mark.parametrize("tf", [None, HOME])
def test_velocities_without_poses_are_no_odometry(script, tmp_path, caplog, kind, speed, tf):
    path = drive(script, speed, starts=1e9, tf=tf).write(tmp_path / f"run.{kind}", kind)
    readings, recording = read(path)
    assert {reading.T_odom_robot for reading in readings} == {None}
    assert (recording.description["odometry"], recording.description["odom_frame"]) == ("none", None)
    (said,) = (each.getMessage() for each in caplog.records if "odometry" in each.getMessage())
    fact = f"/odom holds velocities, but{'' if tf is None else ', like tf,'} one and the same pose from first to last"
    assert said == f"{path}: {fact}; continuing without odometry"
    assert is_explained(said)
    if tf is None:
        with pytest.raises(DatasetError, match=rf"{fact}: choose another with --odometry-topic, or pass --odometry n"):
            open_recording([path], RecordingOptions(odometry="topic"))


def test_a_frame_that_is_asked_for_is_read(script, tmp_path):
    path = drive(script, (0.5, 0.0), starts=1e9, tf=HOME).write(tmp_path / "run.bag")
    assert read(path, odom_frame="odom")[1].description["odometry"] == "tf"
    assert read(path, odometry="tf")[1].description["odometry"] == "tf"


@pytest.mark.parametrize(
    ("speed", "starts"),
    [
        ((0.0, 0.0), 1e9),  # a robot that stands still
        ((0.001, 0.002), 1e9),  # and one whose gyroscope is not quite at rest
        ((0.5, 0.0), 7.0),  # poses that change after what the survey reads
        ((0.5, 0.0), 0.0),
    ],
)
def test_poses_that_may_be_right_are_used(script, tmp_path, caplog, speed, starts):
    path = drive(script, speed, starts=starts).write(tmp_path / "run.bag")
    readings, recording = read(path)
    assert recording.description["odometry"] == "topic"
    assert None not in {reading.T_odom_robot for reading in readings}
    assert "velocities" not in caplog.text


def test_tf_that_moves_is_used_beside_velocities(script, tmp_path):
    script = drive(script, (0.5, 0.0), starts=1e9).drive(99.0, 109.0).in_time_order()
    assert read(script.write(tmp_path / "run.bag"))[1].description["odometry"] == "tf"


def test_tf_that_moves_late_is_used_beside_velocities(script, tmp_path):
    script = drive(script, (0.5, 0.0), starts=1e9, tf=HOME).tf(107.96, "odom", "base_link", SE2(1.0, 0.0, 0.0))
    assert read(script.in_time_order().write(tmp_path / "run.bag"))[1].description["odometry"] == "tf"


@pytest.mark.parametrize("speed", [(0.5, 0.0), (0.0, 0.3)])
def test_a_robot_that_returns_has_moved(script, tmp_path, speed):
    drive(script, speed, seconds=4.0, starts=1e9)
    for k in range(80):
        script.odometry(104.0 + 0.05 * k, HOME, speed=(-speed[0], -speed[1]))
    script = script.in_time_order()
    assert read(script.write(tmp_path / "run.bag"))[1].description["odometry"] == "none"
