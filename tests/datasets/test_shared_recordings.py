"""Recordings that nobody here made; skipped where they are absent."""

import numpy as np
import pytest

from datasets import RecordingOptions, open_recording
from tbmslam.geometry.se2 import SE2


@pytest.mark.parametrize(
    ("name", "scan_topic", "used", "beams", "mounting", "source"),
    [
        ("mit-csail/mit-csail.bag", None, 1988, 361, SE2(0.0, 0.0, 0.0), "tf"),
        ("mit-csail/mit-csail.clf.xz", None, 1988, 361, SE2(0.0, 0.0, 0.0), "FLASER"),
        ("cmu-wean/robotdata1.log", None, 713, 180, SE2(0.25, 0.0, 0.0), "L"),
        ("cmu-wean/robotdata2.log", None, 2251, 180, SE2(0.25, 0.0, 0.0), "L"),
        ("olin-neato/ac109_1_demo.bag", "stable_scan", 548, 361, SE2(-0.1016, 0.0, -3.14159), "tf"),
        ("olin-neato/ac109_3_demo.bag", "scan", 267, 361, SE2(-0.1016, 0.0, -3.14159), "tf"),
        ("racecar-ros1/localization_bag1.bag", None, 281, 1081, SE2(0.0, 0.0, 0.0), "topic"),
        ("racecar-ros2/sct1_v20_a0_m02_1", None, 503, 1081, SE2(0.04, 0.0, 0.0), "tf"),
        ("racecar-ros2/sct1_v20_a0_m02_1/sct1_v20_a0_m02_1_0.db3", None, 503, 1081, SE2(0.04, 0.0, 0.0), "tf"),
    ],
)
def test_each_recording(shared_data, name, scan_topic, used, beams, mounting, source):
    recording = open_recording([shared_data / name], RecordingOptions(scan_topic=scan_topic))
    first, number = None, 0
    for reading in recording:
        first = first or reading
        number += 1
    assert first is not None
    assert (number, len(first.scan.ranges)) == (used, beams)
    assert first.T_robot_sensor == pytest.approx(mounting, abs=1e-5)
    assert recording.description["odometry"] == source


@pytest.mark.slow
@pytest.mark.parametrize(("name", "used"), [("intel/intel.bag", 13631), ("aces/aces.bag", 7374)])
def test_long_recordings(shared_data, name, used):
    recording = open_recording([shared_data / name], RecordingOptions(angle_step_deg=1.0))
    assert sum(1 for _ in recording) == used


def test_a_bag_and_its_log_hold_the_same(shared_data):
    bag = open_recording([shared_data / "mit-csail" / "mit-csail.bag"])
    log = open_recording([shared_data / "mit-csail" / "mit-csail.clf.xz"])
    for ours, theirs in zip(bag, log, strict=True):
        assert ours.scan.stamp == pytest.approx(theirs.scan.stamp, abs=1e-6)
        np.testing.assert_allclose(ours.scan.ranges, theirs.scan.ranges, atol=1e-5)
        assert ours.T_odom_robot == pytest.approx(theirs.T_odom_robot, abs=1e-5)
