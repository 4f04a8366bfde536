"""What is said at the end of a whole drive."""

import math

import numpy as np
import pytest

from tbmslam.calibration.mount_check import MountCheckConfig
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.keyframes import Keyframes
from tbmslam.monitoring.drive_review import DriveReview
from tbmslam.monitoring.odometry_check import OdometryCheckConfig
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, packed
from tbmslam.tracking.tracker import ScanMatch

MOUNT, STARTED = SE2(0.3, 0.0, 0.1), 1000.0
ROOM = np.diag([4e4, 4e4, 1e5])
KNOCK = math.radians(15.0)


def drive(knocked=(), scale=1.0, odometry=True, information=ROOM):
    """Return a trajectory and its keyframes, of a laser that is knocked at keyframes to the left."""
    true, kept, found = SE2.identity(), [], []
    for k in range(300):
        true = true @ SE2(0.15, 0.0, 0.15 * math.sin(k / 5.0))
        wheels = SE2(scale * true.x, scale * true.y, true.theta)
        sensor = true @ MOUNT @ SE2(0.0, 0.0, KNOCK * sum(k >= knock for knock in knocked))
        scan = LaserScan(STARTED + 5.0 + 0.5 * k, -1.0, 0.1, 0.1, 30.0, np.ones(20))
        match = ScanMatch(sensor, 0.9, True, information)
        prior = 25.0**2 * np.eye(3)
        kept.append(TrackedKeyframe.of(k, scan, MOUNT, match, prior, wheels if odometry else None))
        found.append(sensor @ MOUNT.inverse())
    keyframes = packed(kept, np.array(found))
    return Trajectory(keyframes.stamps, keyframes.poses), keyframes, kept


def said(config=None, **kinds):
    review = DriveReview(config or MountCheckConfig(), OdometryCheckConfig(), STARTED, 0.5)
    return review.warnings(*drive(**kinds))


def test_nothing_is_said_of_a_good_drive():
    assert said() == []
    assert said(odometry=False) == []


def test_a_knocked_laser_is_told_with_its_time_and_what_mends_it():
    first, second = said(knocked=(100, 200))
    assert (first.stamp, second.stamp) == (STARTED + 55.0, STARTED + 105.0)
    assert "turned by 15 degrees to the left" in first.what
    assert "--interval 0.0 55.0" in first.what
    assert "--interval 55.0 105.0 with --sensor-pose 0.30 0.00 21" in first.what
    assert "--interval 55.0 105.0, and one" in second.what
    assert "--interval 105.0 154.6 with --sensor-pose 0.30 0.00 36" in second.what
    assert not first.all_along
    assert said(MountCheckConfig(enabled=False), knocked=(100,)) == []


def test_a_wrong_scale_is_told_with_what_it_was_multiplied_by():
    (warning,) = said(scale=2.0)
    assert warning.subject == "scale"
    assert warning.all_along
    assert "--odometry-scale 0.25 mends it" in warning.what
    assert said(scale=2.0, information=np.diag([1.0, 1.0, 1.0])) == []


def test_a_guessed_motion_is_told():
    (warning,) = said(odometry=False, information=np.diag([0.0, 4e4, 1e5]))
    assert warning.what.startswith("for 100% of the drive neither")


def test_a_drive_of_no_readings_is_none():
    nothing = Keyframes.from_scans([], [], [])
    review = DriveReview(MountCheckConfig(), OdometryCheckConfig(), STARTED, 1.0)
    assert review.warnings(Trajectory(np.zeros(0), np.zeros((0, 3))), nothing, []) == []


@pytest.mark.parametrize("turn", [0.04])
def test_less_than_five_degrees_are_no_knock(monkeypatch, turn):
    monkeypatch.setattr(f"{__name__}.KNOCK", turn)
    assert said(knocked=(150,)) == []
