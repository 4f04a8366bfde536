"""Drives that neither odometry nor scans determine."""

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.undetermined_motion import undetermined_motion
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe
from tbmslam.tracking.tracker import ScanMatch

WALL = np.diag([0.0, 4e4, 1e5])
"""Information of a scan along a bare wall."""
ROOM = np.diag([4e4, 4e4, 1e5])
GUESS = np.diag([0.1**-2.0, 0.1**-2.0, 0.1**-2.0])


def keyframe(k, information, odometry=False, moved=True):
    scan = LaserScan(100.0 + 0.5 * k, -1.0, 0.1, 0.1, 30.0, np.ones(20))
    pose = SE2(0.2 * k, 0.0, 0.0)
    match = ScanMatch(pose, 0.9, moved, information)
    return TrackedKeyframe.of(k, scan, SE2.identity(), match, GUESS, pose if odometry else None)


def said(kinds):
    return [(w.what[:20], w.stamp, w.seconds, w.all_along) for w in undetermined_motion(kinds).warnings()]


def test_a_bare_corridor_without_odometry_is_told_as_a_whole():
    motion = undetermined_motion([keyframe(k, WALL) for k in range(50)])
    assert motion.share == 1.0
    (warning,) = motion.warnings()
    assert warning.all_along
    assert warning.what.startswith("for 100% of the drive neither odometry nor scans determine the motion")


def test_a_laser_that_sees_nothing_determines_nothing():
    motion = undetermined_motion([keyframe(k, None if k % 2 else WALL, moved=False) for k in range(50)])
    assert motion.share == 1.0


def test_odometry_or_walls_ahead_determine_it():
    assert undetermined_motion([keyframe(k, WALL, odometry=True) for k in range(50)]).warnings() == []
    assert undetermined_motion([keyframe(k, ROOM) for k in range(50)]).warnings() == []


def test_a_part_of_a_drive_is_told_with_its_time():
    drive = [keyframe(k, WALL if 100 <= k < 108 else ROOM) for k in range(400)]
    (warning,) = undetermined_motion(drive).warnings()
    assert not warning.all_along
    assert (warning.stamp, warning.seconds) == pytest.approx((100.0 + 0.5 * 99, 4.0))
    assert warning.what.startswith("neither odometry")


def test_a_moment_is_no_news():
    assert undetermined_motion([keyframe(k, WALL if k == 100 else ROOM) for k in range(400)]).warnings() == []


def test_matchers_that_do_not_say_are_believed():
    assert undetermined_motion([keyframe(k, None) for k in range(50)]).warnings() == []


def test_drives_without_motions_have_none():
    assert undetermined_motion([]).warnings() == []
    assert undetermined_motion([keyframe(0, WALL)]).warnings() == []
