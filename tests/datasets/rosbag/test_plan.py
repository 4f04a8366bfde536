"""What is read, and how the clocks of its messages are compared."""

import pytest

from datasets import RecordingOptions, open_recording
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
