"""What is read, and how the clocks of its messages are compared."""

import numpy as np
import pytest

from datasets import DatasetError, RecordingOptions, open_recording
from tbmslam.geometry.se2 import SE2


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
    with pytest.raises(DatasetError, match=r"run\.bag: two lasers or robots share /scan, every other scan is of"):
        open_recording([bag])


@pytest.mark.parametrize(
    ("others_lag", "offset"), [(None, 60.04), (0.04, 60.0), (60.04, 60.04)], ids=["alone", "right", "as wrong"]
)
def test_how_long_scans_take_to_arrive_is_told_by_a_laser_whose_clock_is_right(script, tmp_path, others_lag, offset):
    script.drive(100.0, 108.0)
    for k in range(60):
        now = 100.5 + 0.1 * k
        script.scan(now - 60.0, [1.0, 2.0, 3.0 + 0.01 * k], bag_time=now + 0.04)
        if others_lag is not None:
            script.scan(now + 0.04 - others_lag, topic="/rear", frame="rear", bag_time=now + 0.04)
    bag = script.in_time_order().write(tmp_path / "run.bag")
    recording = open_recording([bag], RecordingOptions(scan_topic="/scan"))
    assert recording.description["clock_offset_s"] == pytest.approx(offset, abs=1e-3)
