from dataclasses import replace

import numpy as np
import pytest

from datasets.counts import ReadingCounts
from datasets.odometry.se3 import SE3
from datasets.odometry.source import Mounting, NoMotion, TopicMotion
from datasets.odometry.synchronisation import Pairing, PoseHistory, turned_over
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan


def at(x):
    return SE3(x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def filled(*samples, capacity=1000):
    history = PoseHistory(capacity)
    for stamp, x in samples:
        history.add(stamp, at(x))
    return history


def x_at(history, stamp, longest_gap=10.0, limit=0.2):
    found = history.at(stamp, longest_gap, limit)
    return None if found is None else (pytest.approx(found.pose.x), found.carried_on)


def test_interpolates_and_hits_exactly():
    history = filled((1.0, 0.0), (2.0, 1.0))
    assert x_at(history, 1.25) == (0.25, False)
    assert x_at(history, 2.0) == (1.0, False)
    assert x_at(history, 1.0) == (0.0, False)


def test_before_and_after():
    history = filled((1.0, 0.0), (1.5, 0.5))
    assert x_at(history, 0.99) is None
    assert x_at(history, 1.6) == (0.6, True)
    assert x_at(history, 1.8) is None
    assert x_at(PoseHistory(), 1.0) is None


def test_motion_across_a_long_pause_is_not_carried_on():
    assert x_at(filled((1.0, 0.0), (9.0, 8.0)), 9.1) == (8.0, True)


def test_long_gaps_are_not_interpolated():
    history = filled((1.0, 0.0), (9.0, 8.0))
    assert x_at(history, 5.0, longest_gap=2.0) is None
    assert x_at(history, 1.1, longest_gap=2.0) == (0.0, True)
    assert x_at(history, 8.9, longest_gap=2.0) == (8.0, True)


def test_a_clock_that_steps_back_keeps_the_newest_answer():
    history = filled((1.0, 0.0), (2.0, 1.0), (1.5, 10.0), (2.5, 11.0))
    assert x_at(history, 1.75) == (10.25, False)
    assert x_at(history, 1.25) == (0.25, False)
    assert history.reaches(2.5)
    assert not history.reaches(2.6)


def test_the_same_stamp_twice_means_the_newer_pose():
    assert x_at(filled((1.0, 0.0), (1.0, 5.0)), 1.0) == (5.0, False)


def test_memory_is_bounded():
    history = PoseHistory(10)
    for k in range(1000):
        history.add(k % 7 + 0.001 * k, at(float(k)))
    assert len(history._stamps) < 20
    assert x_at(history, history._stamps[-1]) == (999.0, False)


def test_nearest_holds_the_ends():
    history = filled((1.0, 0.0), (2.0, 1.0))
    assert [history.nearest(stamp).x for stamp in (0.0, 1.5, 3.0)] == pytest.approx([0.0, 0.5, 1.0])
    assert PoseHistory().nearest(1.0) is None


def scan_at(stamp):
    return LaserScan(stamp, -0.5, 0.5, 0.1, 30.0, np.array([1.0, 2.0]))


class Bench:
    def __init__(self, patience=5.0):
        self.motion = TopicMotion(Mounting([], SE2(0.1, 0.0, 0.0), None))
        self.counts = ReadingCounts()
        self.pairing = Pairing(self.motion, self.counts, 0.0, 1.0, patience)
        self.now = 0.0

    def pose(self, stamp, x):
        self.now = max(self.now, stamp)
        self.motion.add(stamp, at(x))
        return list(self.pairing.ready(self.now))

    def scan(self, stamp, now=None):
        self.now = max(self.now, stamp if now is None else now)
        self.pairing.add(scan_at(stamp), self.now)
        return list(self.pairing.ready(self.now))


def test_a_scan_waits_for_the_pose_after_it():
    bench = Bench()
    assert bench.pose(1.0, 0.0) == []
    assert bench.scan(1.5) == []
    (reading,) = bench.pose(2.0, 1.0)
    assert reading.T_odom_robot == pytest.approx(SE2(0.5, 0.0, 0.0))
    assert reading.T_robot_sensor == SE2(0.1, 0.0, 0.0)


def test_late_scans_are_answered_from_memory():
    bench = Bench()
    for k in range(20):
        bench.pose(1.0 + 0.1 * k, float(k))
    (reading,) = bench.scan(1.55, now=2.95)
    assert reading.T_odom_robot == pytest.approx(SE2(5.5, 0.0, 0.0))


def test_a_scan_without_odometry_does_not_hold_up_the_rest():
    bench = Bench(patience=1.0)
    bench.pose(1.0, 0.0)
    bench.scan(2.0)
    (reading,) = bench.scan(3.5)
    assert (reading.scan.stamp, reading.T_odom_robot) == (2.0, None)
    assert bench.counts.without_odometry == 1


def test_a_scan_that_steps_back_waits_for_odometry_that_steps_back():
    bench = Bench()
    bench.pose(1.0, 0.0)
    bench.pose(2.0, 1.0)
    assert len(bench.scan(1.9)) == 1
    assert bench.scan(1.5) == []
    (reading,) = bench.pose(1.5, 7.0)
    assert reading.T_odom_robot == pytest.approx(SE2(7.0, 0.0, 0.0))


def test_a_clock_that_is_set_back_by_an_hour_leaves_scans_their_odometry():
    bench, answered = Bench(), []
    for k in range(40):
        now = 10_000.0 + 0.1 * k
        stamp = now - (3600.0 if k >= 20 else 0.0)
        bench.motion.add(stamp, at(float(k)))
        answered += bench.pairing.ready(now)
        bench.pairing.add(scan_at(stamp + 0.05), now + 0.05)
        answered += bench.pairing.ready(now + 0.05)
    answered += bench.pairing.rest()
    assert len(answered) == 40
    assert bench.counts.dropped == {}
    poses = [reading.T_odom_robot for reading in answered]
    assert poses[19] is None  # the pose after it has the other clock
    del poses[19]
    assert [pose.x for pose in poses] == pytest.approx(np.delete(np.arange(40.0), 19) + 0.5)


def test_what_waits_at_the_end():
    bench = Bench()
    bench.pose(1.0, 0.0)
    bench.pose(1.1, 0.1)
    bench.scan(1.2)
    bench.scan(1.4)
    first, second = bench.pairing.rest()
    assert first.T_odom_robot == pytest.approx(SE2(0.2, 0.0, 0.0))
    assert second.T_odom_robot is None
    assert (bench.counts.extrapolated, bench.counts.without_odometry) == (1, 1)


def test_missing_odometry_is_reported_with_its_time():
    bench = Bench(patience=1.0)
    bench.pose(1.0, 0.0)
    for k in range(40):
        bench.scan(1.08 + 0.1 * k)
    bench.pose(5.0, 0.0)
    bench.pose(5.1, 0.0)
    bench.scan(5.05)
    bench.scan(0.5)
    list(bench.pairing.rest())
    (incident,) = bench.counts.incidents
    assert incident.text(1.0) == "at 0.3 s: no odometry, for 3.5 s: scan matching alone estimates the motion"
    assert bench.counts.dropped == {"before_odometry": 1}


def test_the_last_beam_has_odometry_of_its_own():
    bench = Bench()
    bench.pose(1.0, 0.0)
    bench.pose(1.2, 0.2)
    spinning = replace(scan_at(1.1), time_increment=0.2 / (len(scan_at(1.1).ranges) - 1))
    bench.pairing.add(spinning, 1.1)
    assert list(bench.pairing.ready(1.2)) == []
    (reading,) = bench.pose(1.4, 0.6)
    assert reading.T_odom_robot == pytest.approx(SE2(0.1, 0.0, 0.0))
    assert reading.T_odom_swept == pytest.approx(SE2(0.4, 0.0, 0.0))
    bench.pairing.add(replace(spinning, stamp=1.3), 1.3)
    (reading,) = bench.pairing.rest()
    assert reading.T_odom_swept is None


def test_memory_is_bounded_while_waiting():
    bench = Bench(patience=1e9)
    bench.pose(1.0, 0.0)
    for k in range(6000):
        bench.scan(2.0 + k)
    assert len(bench.pairing._waiting) <= 5001


def test_without_odometry_nothing_waits():
    counts = ReadingCounts()
    pairing = Pairing(NoMotion(Mounting(None, None, None)), counts, 0.0, 1.0, 5.0)
    for stamp in (2.0, 1.0, 3.0):
        pairing.add(scan_at(stamp), stamp)
        (reading,) = pairing.ready(stamp)
        assert (reading.T_odom_robot, reading.scan.stamp) == (None, stamp)


def test_turning_over_twice_changes_nothing():
    scan = scan_at(1.0)
    turned, again = turned_over(scan), turned_over(turned_over(scan))
    assert (turned.angle_min, turned.angle_increment) == (-scan.angle_min, -scan.angle_increment)
    assert (again.angle_min, again.angle_increment) == (scan.angle_min, scan.angle_increment)


def test_a_scan_that_was_taken_at_once_has_no_motion_of_its_own():
    bench = Bench()
    bench.pose(1.0, 0.0)
    bench.scan(1.1)
    (reading,) = bench.pose(1.2, 0.2)
    assert reading.T_odom_robot == pytest.approx(SE2(0.1, 0.0, 0.0))
    assert reading.T_odom_swept is None
