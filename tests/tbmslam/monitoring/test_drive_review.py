"""What is drive_review_said at the end of a whole drive."""

import math

import numpy as np
import pytest

from tbmslam.calibration.mount_check import MountCheckConfig
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.keyframes import Keyframes
from tbmslam.monitoring.drive_review import (
    DriveReview,
    standing_warnings,
    undetermined_motion,
    unusual_speed,
)
from tbmslam.monitoring.odometry_check import OdometryCheckConfig
from tbmslam.sensing.laser_scan import Corrections, LaserScan
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, packed
from tbmslam.tracking.tracker import ScanMatch
from tests.warnings_page import is_explained

STAMPS = 50.0 + 0.1 * np.arange(1000)
NONE = np.full((100, 3), np.nan)


def straight(speeds):
    poses = np.zeros((len(STAMPS), 3))
    poses[:, 0] = np.cumsum(0.1 * speeds)
    return poses


def test_a_drive_of_a_robot():
    assert unusual_speed(STAMPS, straight(np.full(1000, 1.5)), STAMPS[::10], NONE) is None


def test_an_unusual_speed_is_reported_with_its_time():
    speeds = np.where((np.arange(1000) >= 400) & (np.arange(1000) < 600), 7.0, 1.0)
    found = unusual_speed(STAMPS, straight(speeds), STAMPS[::10], NONE)
    assert found is not None
    assert found.speed == pytest.approx(7.0, abs=0.1)
    assert 90.0 <= found.stamp <= 100.0
    assert "at 7.0 m/s for 10 s: unless it is a fast vehicle such as a car, the map is wrong" in found.warning()
    assert is_explained(found.warning())


def test_a_speed_that_the_odometry_confirms_is_accepted():
    poses = straight(np.full(1000, 6.0))
    assert unusual_speed(STAMPS, poses, STAMPS[::10], poses[::10]) is None
    assert unusual_speed(STAMPS, poses, STAMPS[::10], 0.1 * poses[::10]) is not None


def test_noise_and_a_clock_that_steps_back_are_no_speed(generator):
    poses = straight(np.full(1000, 1.0))
    poses[:, 1] += generator.normal(0.0, 0.3, 1000)  # 6 m/s from scan to scan
    back = STAMPS - 30.0 * (np.arange(1000) >= 500)
    for stamps in (STAMPS, back):
        assert unusual_speed(stamps, poses, stamps[::10], NONE) is None


def test_a_few_seconds_tell_nothing():
    poses = straight(np.full(1000, 9.0))
    assert unusual_speed(STAMPS[:50], poses[:50], STAMPS[:50:10], NONE[:5]) is None
    assert unusual_speed(STAMPS[:1], poses[:1], STAMPS[:1], NONE[:1]) is None


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


def test_a_bare_corridor_without_odometry_causes_one_warning():
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


def test_a_part_of_a_drive_is_reported_with_its_time():
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


MOUNT, STARTED = SE2(0.3, 0.0, 0.1), 1000.0
KNOCK = math.radians(15.0)


def drive(knocked=(), scale=1.0, odometry=True, information=ROOM, lag=0.0, aside=0.0, moving=0.0, rounded=0.0):
    """Return a trajectory and its keyframes, of a laser that is knocked at keyframes to the left.

    The odometry is older than the scans by `lag` [s]. The mount is stated too far left by `aside` [m], and by `moving`
    [m] more at each keyframe. Its angle is stated too large and too small in turn, by `rounded` [rad].
    """
    true, kept, found = SE2.identity(), [], []
    for k in range(300):
        angle = math.remainder(MOUNT.theta + (-1) ** k * rounded, math.tau)
        stated = SE2(MOUNT.x, MOUNT.y + aside + moving * k, angle)
        true = true @ SE2(0.15, 0.0, 0.15 * math.sin(k / 5.0))
        old = true @ SE2(-0.3 * lag, 0.0, -0.3 * lag * math.sin(k / 5.0))
        wheels = SE2(scale * old.x, scale * old.y, old.theta)
        sensor = true @ MOUNT @ SE2(0.0, 0.0, KNOCK * sum(k >= knock for knock in knocked))
        scan = LaserScan(STARTED + 5.0 + 0.5 * k, -1.0, 0.1, 0.1, 30.0, np.ones(20))
        match = ScanMatch(sensor, 0.9, True, information)
        prior = 25.0**2 * np.eye(3)
        kept.append(TrackedKeyframe.of(k, scan, stated, match, prior, wheels if odometry else None))
        found.append(sensor @ stated.inverse())
    keyframes = packed(kept, np.array(found))
    return Trajectory(keyframes.stamps, keyframes.poses), keyframes, kept


def drive_review_said(config=None, **kinds):
    review = DriveReview(
        config or MountCheckConfig(), OdometryCheckConfig(), STARTED, Corrections(odometry_scale=0.5, clock_offset=82.0)
    )
    return review.warnings(*drive(**kinds))


def test_a_good_drive_has_no_warning():
    assert drive_review_said() == []
    assert drive_review_said(odometry=False) == []


def test_a_knocked_laser_is_reported_with_its_time_and_the_remedy():
    first, second = drive_review_said(knocked=(100, 200))
    assert (first.stamp, second.stamp) == (STARTED + 55.0, STARTED + 105.0)
    assert "turned by 15 degrees to the left" in first.what
    assert "--interval 0.0 55.0, and the second" in first.what
    assert "--interval 55.0 105.0 with --sensor-pose 0.30 0.00 21" in first.what
    assert "--interval 55.0 105.0 with --sensor-pose 0.30 0.00 21, and the second" in second.what
    assert "--interval 105.0 154.6 with --sensor-pose 0.30 0.00 36" in second.what
    assert not first.all_along
    assert drive_review_said(MountCheckConfig(enabled=False), knocked=(100,)) == []


def test_a_laser_that_sits_elsewhere_is_reported_unless_it_moves_or_the_check_is_disabled():
    (warning,) = drive_review_said(aside=0.3)
    assert warning.subject == "mount"
    assert warning.what.endswith("try --sensor-pose 0.30 0.00 6")
    assert drive_review_said(aside=0.3, moving=1e-4) == []
    assert drive_review_said(MountCheckConfig(enabled=False), aside=0.3) == []


@pytest.mark.parametrize("theta", [0.1, math.pi])
def test_a_mount_that_rounding_moves_is_judged(monkeypatch, theta):
    """Logs round each pose; of a laser that looks backwards, angles are then on both sides of pi."""
    monkeypatch.setattr(f"{__name__}.MOUNT", SE2(0.3, 0.0, theta))
    (warning,) = drive_review_said(aside=0.3, moving=1e-8, rounded=1e-6)
    assert warning.what.endswith(f"try --sensor-pose 0.30 0.00 {math.degrees(theta):.0f}")


def test_a_wrong_scale_is_reported_with_its_factor():
    (warning,) = drive_review_said(scale=2.0)
    assert warning.subject == "scale"
    assert warning.all_along
    assert "--odometry-scale 0.25" in warning.what
    assert drive_review_said(scale=2.0, information=np.diag([1.0, 1.0, 1.0])) == []


@pytest.mark.parametrize("lag", [0.2, -0.25])
def test_clocks_that_differ_are_reported_with_the_offset_to_use(lag):
    (warning,) = drive_review_said(lag=lag)
    assert warning.subject == "clock"
    # The turning speed changes between keyframes half a second apart.
    assert float(warning.what.rpartition("--clock-offset ")[2]) == pytest.approx(82.0 + lag, abs=0.07)
    assert {warning.subject for warning in drive_review_said(lag=lag, knocked=(150,))} == {"mount change"}


def test_a_guessed_motion_is_reported():
    (warning,) = drive_review_said(odometry=False, information=np.diag([0.0, 4e4, 1e5]))
    assert warning.what.startswith("for 100% of the drive neither")


def test_a_drive_of_no_readings_is_none():
    nothing = Keyframes.from_scans([], [], [])
    review = DriveReview(MountCheckConfig(), OdometryCheckConfig(), STARTED, Corrections())
    assert review.warnings(Trajectory(np.zeros(0), np.zeros((0, 3))), nothing, []) == []


@pytest.mark.parametrize("turn", [0.04])
def test_less_than_five_degrees_are_no_knock(monkeypatch, turn):
    monkeypatch.setattr(f"{__name__}.KNOCK", turn)
    assert drive_review_said(knocked=(150,)) == []


def test_a_robot_that_stands_still_is_told_how_to_get_a_map():
    trajectory, keyframes, kept = drive()
    first = packed(kept[:1], trajectory.poses[:1])
    still = Trajectory(STARTED + 0.1 * np.arange(436), np.zeros((436, 3)))
    (warning,) = standing_warnings(still, first)
    assert warning.all_along
    assert warning.what.startswith("the robot hardly moved (0.0 m): the map is drawn from 1 of 436 scans")
    assert warning.what.endswith("--set keyframes.distance=0")
    assert standing_warnings(still, keyframes) == []
    assert standing_warnings(Trajectory(still.stamps[:9], still.poses[:9]), first) == []
    assert standing_warnings(Trajectory(np.zeros(0), np.zeros((0, 3))), Keyframes.from_scans([], [], [])) == []
