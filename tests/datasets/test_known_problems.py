"""Problems with recordings that users of other programs reported."""

import math

import numpy as np
import pytest

from datasets import DatasetError, RecordingOptions, open_recording
from datasets.counts import ReadingCounts
from datasets.odometry.se3 import SE3
from datasets.scans.cleaning import RangeRules
from datasets.scans.intake import RawScan, ScanIntake
from datasets.synthetic.bag_writing import Messages
from tbmslam.geometry.se2 import SE2


def driven(script, until=110.0):
    return script.tf(99.0, "base_link", "laser", topic="/tf_static").drive(100.0, until)


def angles(scan):
    return scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))


def read(script, tmp_path, **options):
    recording = open_recording([script.in_time_order().write(tmp_path / "run.bag")], RecordingOptions(**options))
    return list(recording), recording.counts


def test_the_number_of_beams_varies(script, tmp_path):
    driven(script)
    for k, beams in enumerate((180, 181, 179, 361)):
        script.scan(101.0 + k, np.full(beams, 2.0 + k), angle_min=-1.5, step=0.005)
    readings, counts = read(script, tmp_path)
    assert [len(reading.scan.ranges) for reading in readings] == [180, 181, 179, 361]
    assert counts.beam_count_changes == 3


def test_angle_max_is_not_trusted(script, tmp_path):
    (reading,), _ = read(driven(script).scan(101.0, [1.0, 2.0, 3.0], angle_min=0.1, step=0.2), tmp_path)
    assert angles(reading.scan) == pytest.approx([0.1, 0.3, 0.5], abs=1e-6)  # the message says 99


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan], ids=["d03_inf", "d03_minus_inf", "d04_nan"])
def test_ranges_that_are_no_numbers(script, tmp_path, value):
    (reading,), _ = read(driven(script).scan(101.0, [value, 2.0, value]), tmp_path)
    assert np.isfinite(reading.scan.ranges).tolist() == [False, True, False]
    assert len(reading.scan.hit_points()) == 1


def test_an_empty_scan_is_dropped(script, tmp_path):
    readings, counts = read(driven(script).scan(101.0, []).scan(101.1), tmp_path)
    assert (len(readings), counts.dropped) == (1, {"empty": 1})


def test_backward_and_duplicate_stamps(script, tmp_path):
    driven(script).scan(101.0, [1.0]).scan(101.0, [1.0], bag_time=101.01).scan(101.0, [2.0], bag_time=101.02)
    readings, counts = read(script.scan(100.9, [3.0], bag_time=101.1), tmp_path)
    assert [reading.scan.ranges[0] for reading in readings] == [1.0, 2.0, 3.0]
    assert (counts.dropped, counts.same_stamps, counts.backward_stamps) == ({"duplicate": 1}, 1, 1)


def test_stamps_of_another_clock_than_the_bags(script, tmp_path):
    driven(script)
    for k in range(60):
        script.scan(101.0 + 0.1 * k - 82.2, [1.0 + k], bag_time=101.0 + 0.1 * k)
    readings, _ = read(script, tmp_path)
    assert readings[0].T_odom_robot.x == pytest.approx(1.0, abs=1e-6)


def test_a_wrong_time_increment_is_not_believed():
    counts = ReadingCounts()
    intake = ScanIntake(RangeRules(None, None, (), "free"), None, 2.0, counts, longest_sweep=0.05)
    for k, increment in enumerate((1e-5, 7.0, -1.0, math.nan)):
        scan = intake.take(RawScan(float(k), 0.0, 0.1, 0.1, 30.0, np.ones(30), increment))
        assert 0.0 <= scan.time_increment < 1e-3


def test_scans_without_transforms_are_counted(script, tmp_path):
    _, counts = read(driven(script).scan(99.5).scan(99.6).scan(101.0), tmp_path)
    assert counts.dropped == {"before_odometry": 2}
    assert "2 before_odometry" in counts.summary()


def test_a_laser_that_hangs_upside_down(script, tmp_path):
    script.tf(99.0, "base_link", "laser", SE3(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), topic="/tf_static")
    (reading,), _ = read(script.drive(100.0, 103.0).scan(101.0, [1.0, 2.0, 3.0], angle_min=0.1, step=0.2), tmp_path)
    assert angles(reading.scan) == pytest.approx([-0.1, -0.3, -0.5], abs=1e-6)


def test_nothing_in_range_is_free_and_no_hit(script, tmp_path):
    (reading,), counts = read(driven(script).scan(101.0, [np.inf, 65.533, 2.0]), tmp_path)
    assert reading.scan.ranges.tolist() == [np.inf, np.inf, 2.0]
    assert counts.beams == {"hit": 1, "no_return": 2}


def test_a_bag_that_is_cut_off_gives_what_is_left(script, tmp_path):
    driven(script, 106.0)
    for k in range(50):
        script.scan(100.5 + 0.1 * k, np.full(500, 1.0 + k), step=0.005)
    path = script.in_time_order().write(tmp_path / "run.bag")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert 15 < len(list(open_recording([path]))) < 35


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_a_ros_2_bag_without_metadata_or_cut_off(script, tmp_path, kind):
    driven(script, 106.0)
    for k in range(50):
        script.scan(100.5 + 0.1 * k, np.full(500, 1.0 + k), step=0.005)
    folder = script.in_time_order().write(tmp_path / "run", kind)
    (folder / "metadata.yaml").unlink()
    (storage,) = folder.iterdir()
    assert len(list(open_recording([folder]))) == 50
    storage.write_bytes(storage.read_bytes()[: storage.stat().st_size * 3 // 5])
    assert 10 < len(list(open_recording([folder]))) < 50


def test_messages_of_ros_1_have_their_sequence_number():
    messages = Messages(ros1=True)
    scan = {"angle_min": 0.0, "angle_max": 0.0, "angle_increment": 0.1, "time_increment": 0.0, "scan_time": 0.0}
    scan |= {"range_min": 0.0, "range_max": 1.0, "ranges": np.ones(2, np.float32)}
    data = messages.scan(5_000_000_007, "laser", scan)
    assert data[:4] == bytes(4)  # seq
    assert int.from_bytes(data[4:8], "little") == 5
    assert messages.store.deserialize_ros1(data, "sensor_msgs/msg/LaserScan").header.frame_id == "laser"


def test_several_topics_and_stamps_left_at_zero(script, tmp_path):
    driven(script).scan(101.0, topic="/a").scan(0.0, topic="/b", bag_time=102.0)
    with pytest.raises(
        DatasetError, match=r"several LaserScan topics hold scans: /a \(1 scan\), /b \(1 scan\): choose"
    ):
        read(script, tmp_path)
    (tmp_path / "other").mkdir()
    (reading,), _ = read(script, tmp_path / "other", scan_topic="/b")
    assert reading.scan.stamp == pytest.approx(102.0)
    assert reading.T_odom_robot == pytest.approx(SE2(2.0, 0.0, 0.2), abs=1e-6)
