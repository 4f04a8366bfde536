import bz2
import gzip
import lzma
import math
import re

import numpy as np
import pytest

from datasets import DatasetError, RecordingOptions, open_recording
from datasets.recording import recording_warnings
from datasets.text_files import lines_of
from tbmslam.geometry.se2 import SE2

TIMES = "{ipc:.6f} host {logger:.6f}"


def flaser(k, ranges=None, tail=TIMES):
    values = ranges if ranges is not None else [1.0 + 0.01 * k] * 180
    words = " ".join(f"{value:.2f}" for value in values)
    times = tail.format(ipc=1000.0 + 0.2 * k, logger=0.2 * k)
    return f"FLASER {len(values)} {words} 90 90 1 {0.1 * k:.3f} 0.5 0.2 {times}\n"


def robot_laser(k, kind="ROBOTLASER1"):
    poses = f"{0.1 * k + 0.3:.3f} 0.5 0 {0.1 * k:.3f} 0.5 0 0 0 0.3 0.3 1e9 " if kind == "ROBOTLASER1" else ""
    ranges = "1.5 2.5 81.91"
    return f"{kind} 0 -0.1 0.2 0.1 50.0 0.01 0 3 {ranges} 2 7 8 {poses}{1000 + 0.2 * k:.6f} host {0.2 * k:.6f}\n"


def odom(stamp, x):
    return f"ODOM {x:.3f} 0.5 0.2 0 0 0 {stamp:.6f} host {stamp - 1000.0:.6f}\n"


def read(path, text, **options):
    path.write_text(text)
    recording = open_recording([path], RecordingOptions(**options))
    return list(recording), recording


@pytest.mark.parametrize(
    ("suffix", "packed"), [("", bytes), ("gz", gzip.compress), ("bz2", bz2.compress), ("xz", lzma.compress)]
)
def test_flaser_plain_and_compressed(tmp_path, suffix, packed):
    path = tmp_path / f"run.log.{suffix}"
    path.write_bytes(packed(("# a comment\n" + "".join(flaser(k) for k in range(20))).encode()))
    recording = open_recording([path])
    readings = list(recording)
    assert len(readings) == 20 == recording.expected_scans
    assert recording.name == "run"
    assert readings[3].scan.stamp == pytest.approx(1000.6)
    assert readings[3].T_odom_robot == pytest.approx(SE2(0.3, 0.5, 0.2)), "raw odometry, not the corrected pose"
    assert readings[3].T_robot_sensor == SE2.identity()


@pytest.mark.parametrize(
    ("beams", "step", "start"), [(180, 1.0, -90), (181, 1.0, -90), (360, 0.5, -90), (361, 0.5, -90), (401, 0.25, -50)]
)
def test_the_fan_of_a_sick(tmp_path, beams, step, start):
    readings, _ = read(tmp_path / "run.log", flaser(0, [2.0] * beams))
    assert math.degrees(readings[0].scan.angle_increment) == pytest.approx(step)
    assert math.degrees(readings[0].scan.angle_min) == pytest.approx(start)


def test_codes_and_limits(tmp_path):
    readings, recording = read(tmp_path / "run.log", flaser(0, [81.83, 81.91, 79.0, 0.0, 80.0] + [2.0] * 175))
    np.testing.assert_array_equal(readings[0].scan.ranges[:5], [np.inf, np.inf, 79.0, np.nan, np.inf])
    assert recording.counts.beams == {"hit": 176, "no_return": 3, "zero": 1}


def test_a_code_below_the_limit_is_found_in_the_data(tmp_path):
    rng = np.random.default_rng(0)
    lines = [flaser(k, np.where(np.arange(180) % 20 == 0, 50.0, rng.uniform(1.0, 20.0, 180))) for k in range(100)]
    readings, recording = read(tmp_path / "run.log", "".join(lines))
    assert 50.0 in recording.description["no_return_codes_m"]
    assert np.isinf(readings[0].scan.ranges[::20]).all()


def test_robot_laser_states_its_own_geometry(tmp_path):
    readings, recording = read(tmp_path / "run.log", "".join(robot_laser(k) for k in range(5)))
    scan = readings[2].scan
    assert (scan.angle_min, scan.angle_increment, scan.range_max) == (-0.1, 0.1, 50.0)
    np.testing.assert_array_equal(scan.ranges, [1.5, 2.5, np.inf])
    assert readings[2].T_odom_robot == pytest.approx(SE2(0.2, 0.5, 0.0))
    assert readings[2].T_robot_sensor == pytest.approx(SE2(0.3, 0.0, 0.0))
    assert recording.description["odometry"] == "ROBOTLASER1"


def test_raw_laser_takes_odometry_from_odom(tmp_path):
    lines = ["PARAM robot_frontlaser_offset 0.25\n"]
    for k in range(10):
        lines += [odom(1000.0 + 0.2 * k - 0.05, float(k)), robot_laser(k, "RAWLASER1")]
    readings, recording = read(tmp_path / "run.log", "".join(lines))
    assert [reading.T_odom_robot.x for reading in readings[:-1]] == pytest.approx([k + 0.25 for k in range(9)])
    assert recording.counts.extrapolated == 1
    assert recording.description["clock_offset_s"] == 0.0
    readings, recording = read(tmp_path / "run.log", "".join(lines), clock_offset=0.05)
    assert [reading.T_odom_robot.x for reading in readings[:-1]] == pytest.approx([k + 0.5 for k in range(9)])
    assert recording.description["clock_offset_s"] == 0.05
    assert readings[0].T_robot_sensor == SE2(0.25, 0.0, 0.0)


def cmu_laser(k):
    return f"L {10.0 * k:.3f} 50 0 {10.0 * k + 30.0:.3f} 50 0 {' '.join(['100'] * 180)} {1000.0 + 0.2 * k:.6f}\n"


@pytest.mark.parametrize(
    ("line", "mount"), [(flaser, SE2.identity()), (robot_laser, SE2(0.3, 0.0, 0.0)), (cmu_laser, SE2(0.3, 0.0, 0.0))]
)
def test_poses_in_lines_of_scans_are_looked_up_at_another_time(tmp_path, line, mount):
    text = "".join(line(k) for k in range(10))
    readings, recording = read(tmp_path / "run.log", text, clock_offset=-0.05, odometry_scale=2.0, upside_down=True)
    assert [reading.scan.stamp for reading in readings] == pytest.approx([1000.0 + 0.2 * k for k in range(1, 10)])
    assert [reading.T_odom_robot.x for reading in readings] == pytest.approx([0.2 * k - 0.05 for k in range(1, 10)])
    assert recording.counts.dropped == {"before_odometry": 1}
    assert all(reading.T_robot_sensor == pytest.approx(mount) for reading in readings)
    assert all(reading.scan.angle_increment < 0.0 for reading in readings)
    assert recording.description["clock_offset_s"] == -0.05


def test_poses_in_lines_of_scans_later_than_the_scans(tmp_path):
    readings, recording = read(tmp_path / "run.log", "".join(flaser(k) for k in range(10)), clock_offset=0.3)
    assert [reading.T_odom_robot.x for reading in readings[:-1]] == pytest.approx([0.1 * k + 0.15 for k in range(9)])
    assert readings[-1].T_odom_robot is None
    assert recording.counts.extrapolated == 1


def test_scans_far_apart_keep_their_odometry_at_another_time(tmp_path):
    text = "".join(flaser(k) for k in range(0, 400, 40))  # 8 s apart
    readings, recording = read(tmp_path / "run.log", text, clock_offset=0.4)
    assert [reading.T_odom_robot.x for reading in readings[:-1]] == pytest.approx([4.0 * k + 0.2 for k in range(9)])
    assert recording.counts.without_odometry == 1


def test_a_laser_that_looks_backwards_has_one_mount_at_another_time(tmp_path):
    """Rounded angles lie on both sides of pi."""
    lines = [robot_laser(k).replace(" 0.5 0 ", f" 0.5 {(-1) ** (k // 10) * 3.14159} ", 1) for k in range(40)]
    readings, recording = read(tmp_path / "run.log", "".join(lines), clock_offset=-0.05)
    assert abs(readings[5].T_robot_sensor.theta) == pytest.approx(math.pi, abs=1e-4)
    assert abs(recording.description["T_robot_sensor"][2]) == pytest.approx(math.pi, abs=1e-4)


def test_lines_of_scans_that_are_dropped_state_odometry_too(tmp_path):
    def turned(k):  # the robot drives aside from the sixth line on
        line = robot_laser(k).replace(" 0.5 0 ", f" {0.5 + max(k - 5, 0)} 0 ")
        return line.replace(" 0.2 0.1 ", " 0.2 0 ") if 3 <= k < 8 else line  # an angle of 0 between the beams

    text = "".join(turned(k) for k in range(12))
    readings, recording = read(tmp_path / "run.log", text, clock_offset=-0.05, sensor_pose=SE2(0.1, 0.0, 0.0))
    assert recording.counts.dropped == {"before_odometry": 1, "unreadable": 5}
    assert readings[2].T_odom_robot.y == pytest.approx(3.25)
    assert readings[2].T_robot_sensor == SE2(0.1, 0.0, 0.0)


@pytest.mark.parametrize(("options", "x"), [({}, 0.3), ({"clock_offset": 0.0}, 0.3), ({"odometry": "none"}, None)])
def test_poses_in_lines_of_scans_stay_without_an_offset(tmp_path, options, x):
    readings, recording = read(tmp_path / "run.log", "".join(robot_laser(k) for k in range(10)), **options)
    assert getattr(readings[3].T_odom_robot, "x", None) == x
    assert readings[3].T_robot_sensor.x == pytest.approx(0.3)
    assert recording.description["clock_offset_s"] is None
    readings, _ = read(tmp_path / "run.log", "".join(flaser(k) for k in range(10)), odometry="none", clock_offset=0.3)
    assert [reading.T_odom_robot for reading in readings] == [None] * 10


def test_a_raw_laser_without_odometry(tmp_path, caplog):
    text = "".join(robot_laser(k, "RAWLASER1") for k in range(10))
    readings, recording = read(tmp_path / "run.log", text)
    assert [reading.T_odom_robot for reading in readings] == [None] * 10
    assert recording.description["odometry"] == "none"
    assert "no line of ODOM holds odometry; continuing without it" in caplog.text
    caplog.clear()
    read(tmp_path / "run.log", text, odometry="none")
    assert "ODOM" not in caplog.text


def test_the_kind_of_line_can_be_chosen(tmp_path):
    text = "".join(flaser(k) + robot_laser(k) for k in range(3))
    assert read(tmp_path / "run.log", text)[1].description["scan_topic"] == "FLASER"
    assert len(read(tmp_path / "run.log", text, scan_topic="ROBOTLASER1")[0][0].scan.ranges) == 3
    with pytest.raises(DatasetError, match=r"has no RAWLASER1; it has FLASER, ROBOTLASER1: choose with --scan-topic"):
        read(tmp_path / "run.log", text, scan_topic="RAWLASER1")


def test_logger_time_where_the_other_is_useless(tmp_path):
    text = "".join(flaser(k, tail="0 host {logger:.6f}") for k in range(1, 40))
    readings, recording = read(tmp_path / "run.log", text)
    assert readings[0].scan.stamp == pytest.approx(0.2)
    assert recording.description["times"] == "logger"


@pytest.mark.parametrize(
    "tail", ["0 host 0", "1.01893e+09 host 1.01893e+09", "-3 host -3", "0 host 1.1e9", "host 0", ""]
)
def test_scans_without_times_are_a_second_apart(tmp_path, tail, caplog):
    text = "".join(flaser(k, tail=tail) for k in range(2500))
    readings, recording = read(tmp_path / "run.log", text.replace("FLASER 180", "FLASER 280", 1))
    assert [reading.scan.stamp for reading in readings] == list(range(1, 2500)), "the first line is damaged"
    assert [reading.T_odom_robot.x for reading in readings[:3]] == pytest.approx([0.1, 0.2, 0.3])
    assert recording.description["times"] == "none"
    assert "the scans have no usable times" in caplog.text
    assert "the scans have no usable times" in recording_warnings(recording)[-1]


def test_few_times_are_no_times(tmp_path):
    tails = ["0.5 host 0.5", "0.9 host 0.9"] + 48 * ["4.29497e+09 host 4.29497e+09"]  # a time before zero wrapped
    text = "".join(10 * flaser(k, tail=tail) for k, tail in enumerate(tails))
    assert read(tmp_path / "run.log", text)[1].description["times"] == "none"


def test_a_logger_time_alone(tmp_path):
    readings, recording = read(tmp_path / "run.log", "".join(flaser(k, tail="host {logger:.6f}") for k in range(1, 40)))
    assert [reading.scan.stamp for reading in readings[:2]] == pytest.approx([0.2, 0.4])
    assert recording.description["times"] == "logger"


def test_odometry_without_times_belongs_to_the_next_scan(tmp_path):
    text = ""
    for k in range(30):
        lines = [odom(1000.0, k - 0.5), odom(1000.0, float(k)), robot_laser(k, "RAWLASER1")]
        text += "".join(re.sub(r"\S+ host \S+$", "0 host 0", line.rstrip()) + "\n" for line in lines)
    readings, recording = read(tmp_path / "run.log", text)
    assert recording.description["times"] == "none"
    assert [reading.T_odom_robot.x for reading in readings] == pytest.approx(list(range(30)))


@pytest.mark.parametrize(("first", "expected"), [("{x} 0 0.5", 0.3), ("7 0 0.5", 0.0)])
def test_the_first_pose_where_the_second_never_changes(tmp_path, first, expected):
    ranges = " ".join(["2.0"] * 180)
    lines = [f"FLASER 180 {ranges} {first.format(x=0.1 * k)} 0 0 0 {k} host {k}\n" for k in range(1, 40)]
    readings, _ = read(tmp_path / "run.log", "".join(lines))
    assert readings[2].T_odom_robot.x == pytest.approx(expected)


def test_damaged_lines_are_counted(tmp_path):
    text = flaser(0) + flaser(1)[:200] + "\nFLASER x\n" + flaser(2)
    readings, recording = read(tmp_path / "run.log", text)
    assert len(readings) == 2
    assert recording.counts.dropped == {"unreadable": 2}


def test_options_apply(tmp_path):
    options = {"sensor_pose": SE2(1.0, 0.0, 0.0), "odometry": "none", "angle_step_deg": 0.5, "upside_down": True}
    readings, _ = read(tmp_path / "run.log", flaser(0), **options)
    assert readings[0].T_odom_robot is None
    assert readings[0].T_robot_sensor == SE2(1.0, 0.0, 0.0)
    assert readings[0].scan.angle_increment == pytest.approx(math.radians(-0.5))


def test_cmu_logs_are_in_centimetres(tmp_path):
    ranges = " ".join(["100"] * 179 + ["8183"])
    readings, _ = read(tmp_path / "run.log", f"O 10 20 0 0.1\nL 100 200 0 125 200 0 {ranges} 0.2\n")
    assert readings[0].T_odom_robot == pytest.approx(SE2(1.0, 2.0, 0.0))
    assert readings[0].T_robot_sensor == pytest.approx(SE2(0.25, 0.0, 0.0))
    assert readings[0].scan.ranges[0] == pytest.approx(1.0)
    assert np.isinf(readings[0].scan.ranges[-1])


def test_text_that_is_no_recording(tmp_path):
    with pytest.raises(DatasetError, match=r"notes\.txt: no ROS bag, and no line of FLASER, ROBOTLASER1, RAWLASER1, L"):
        read(tmp_path / "notes.txt", "L'horloge\nhello\n")


def test_a_cut_off_archive(tmp_path):
    path = tmp_path / "run.log.xz"
    path.write_bytes(
        lzma.compress("".join(flaser(k, np.random.default_rng(k).uniform(1, 9, 180)) for k in range(99)).encode())[
            :-500
        ]
    )
    with pytest.raises(DatasetError, match=r"run\.log\.xz: cannot be read to its end .*fetch the file again"):
        list(open_recording([path]))


def test_a_damaged_archive(tmp_path):
    rng = np.random.default_rng(0)
    packed = bytearray(gzip.compress("".join(flaser(k, rng.uniform(1, 9, 180)) for k in range(99)).encode()))
    packed[10:60] = bytes([0xFF] * 50)
    path = tmp_path / "run.log.gz"
    path.write_bytes(packed)
    with pytest.raises(DatasetError, match=r"run\.log\.gz: cannot be read to its end .*fetch the file again"):
        list(open_recording([path]))


def test_several_logs_follow_each_other(tmp_path):
    for name, start in (("a", 0), ("b", 10)):
        (tmp_path / name).write_text("".join(flaser(k) for k in range(start, start + 10)))
    readings = list(open_recording([tmp_path / "a", tmp_path / "b"]))
    assert [r.scan.stamp for r in readings] == pytest.approx([1000.0 + 0.2 * k for k in range(20)])


@pytest.mark.parametrize(("blank", "margin"), [("\t", ""), ("  ", " \t")])
def test_lines_of_any_white_space(tmp_path, blank, margin):
    lines = [line for k in range(10) for line in (odom(1000.0 + 0.2 * k, float(k)), robot_laser(k, "RAWLASER1"))]
    readings, _ = read(tmp_path / "run.log", "".join(margin + line.replace(" ", blank) for line in lines))
    assert [reading.T_odom_robot.x for reading in readings] == pytest.approx(list(range(10)))


def test_commas_for_points(tmp_path):
    text = "".join(flaser(k) for k in range(20))
    readings, _ = read(
        tmp_path / "run.log", "PARAM robot_frontlaser_offset 0,1 0,0 host 0,0\n" + text.replace(".", ",")
    )
    plain, _ = read(tmp_path / "plain.log", "PARAM robot_frontlaser_offset 0.1 0.0 host 0.0\n" + text)
    assert [r.T_odom_robot for r in readings] == [r.T_odom_robot for r in plain]
    assert readings[5].scan.ranges.tolist() == plain[5].scan.ranges.tolist()
    assert readings[5].T_robot_sensor == plain[5].T_robot_sensor


@pytest.mark.parametrize("number", ["nan", "inf", "1e300"])
@pytest.mark.parametrize("place", [-6, -4, -3])
def test_poses_and_times_that_cannot_be_are_left_out(tmp_path, number, place):
    lines = [flaser(k).split() for k in range(20)]
    lines[7][place] = number
    readings, recording = read(tmp_path / "run.log", "".join(" ".join(words) + "\n" for words in lines))
    assert len(readings) == 19
    assert recording.counts.dropped == {"unreadable": 1}


@pytest.mark.parametrize("value", ["nan", "inf", "1e300"])
def test_parameters_that_cannot_be_do_not_count(tmp_path, value):
    head = f"PARAM robot_frontlaser_offset {value} 0 h 0\nPARAM robot_front_laser_max {value} 0 h 0\n"
    readings, _ = read(tmp_path / "run.log", head + "".join(flaser(k) for k in range(5)))
    assert readings[0].T_robot_sensor == SE2.identity()
    assert len(readings[0].scan.hit_points()) == 180


def test_a_line_without_end_does_not_fill_the_memory(tmp_path):
    path = tmp_path / "run.log.gz"
    path.write_bytes(gzip.compress(b"FLASER 180 " + b"1 " * (1 << 23) + b"\n" + flaser(1).encode(), compresslevel=1))
    lengths = [len(line) for line in lines_of(path)]
    assert max(lengths) == 1 << 22
    assert sum(lengths) == 11 + (1 << 24) + 1 + len(flaser(1))
