from dataclasses import replace

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2, laid_out, wrap_angles
from tbmslam.loop_closure.odometry_headings import OdometryHeadings
from tbmslam.map.drive import DriveMotions
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe
from tbmslam.tracking.tracker import ScanMatch

COUNT, LOOP = 2000, 500
LEARNT, OWN = 0.004, 0.003  # deviations of a turn by odometry and of a tracked turn [rad]


def drive_of(wheels, tracked):
    """Return a straight drive with errors of the headings by odometry and of the tracked turns, and exact closures."""
    steps = np.column_stack((np.full(COUNT, 0.25), np.zeros(COUNT), tracked))
    informations = np.tile(np.diag([1e4, 1e4, OWN**-2.0]), (COUNT, 1, 1))
    variances = np.full(COUNT, LEARNT**2)
    sure = np.diag([1e6, 1e6, 1e6])
    closures = [MotionEdge(k, k + LOOP, SE2(0.25 * LOOP, 0.0, 0.0), sure) for k in range(0, COUNT - LOOP + 1, LOOP)]
    return OdometryHeadings(np.diff(wheels), variances, variances.copy()), DriveMotions(steps, informations), closures


def headings_of(motions):
    return laid_out(np.zeros(3), motions.steps)[:, 2]


def spread(headings):
    return np.std(wrap_angles(headings))


@pytest.fixture
def noise():
    return np.random.default_rng(2)


def test_absolute_headings_hold_headings_of_scans_that_drift(noise):
    absolute = noise.normal(0.0, LEARNT / np.sqrt(2.0), COUNT + 1)
    headings, motions, closures = drive_of(absolute, noise.normal(0.0, OWN, COUNT))
    fused = headings.fused(motions, closures)
    assert spread(headings_of(motions)) > 0.03
    assert spread(headings_of(fused)) < 0.006
    # The result has neither the jitter of the odometry nor that of the scans.
    assert np.std(np.diff(headings_of(fused))) < 0.8 * OWN
    assert (fused.informations[:, 2, 2] > 2.0 * OWN**-2.0).all()
    assert fused.informations[:, :2, :2] == pytest.approx(motions.informations[:, :2, :2])


@pytest.mark.parametrize("rate", [1.2, 4.0])
def test_odometry_that_drifts_as_learnt_or_faster_changes_nothing(noise, rate):
    walk = np.concatenate(([0.0], np.cumsum(noise.normal(0.0, rate * LEARNT, COUNT))))
    headings, motions, closures = drive_of(walk, noise.normal(0.0, OWN, COUNT))
    assert headings.fused(motions, closures) is None


def test_nothing_changes_without_closures(noise):
    headings, motions, _ = drive_of(np.zeros(COUNT + 1), noise.normal(0.0, OWN, COUNT))
    assert headings.fused(motions, []) is None


def test_scans_that_drift_less_than_stated_are_believed_more_than_odometry(noise):
    """In simulated offices the floor of their variances is far too large, and odometry must not spoil them."""
    absolute = noise.normal(0.0, LEARNT / np.sqrt(2.0), COUNT + 1)
    headings, motions, closures = drive_of(absolute, noise.normal(0.0, 0.01 * OWN, COUNT))
    assert spread(headings_of(headings.fused(motions, closures))) < 0.0015


def test_a_slip_is_not_believed(noise):
    """The scan contradicted the odometry there, so the variance of that turn is large."""
    absolute = noise.normal(0.0, LEARNT / np.sqrt(2.0), COUNT + 1)
    absolute[1200:] += 0.3
    headings, motions, closures = drive_of(absolute, noise.normal(0.0, OWN, COUNT))
    headings.variances[1199] *= 1000.0
    before, after = (headings_of(headings.fused(motions, closures[:2]))[[1190, 1210]]).tolist()
    assert after - before < 0.1


def test_an_error_of_heading_takes_the_position_with_it(noise):
    """A laser ahead of the robot's centre: a turn moves it sideways."""
    headings, motions, closures = drive_of(np.zeros(COUNT + 1), np.full(COUNT, 0.001))
    covariance = np.array([[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.5 * OWN**2], [0.0, 0.5 * OWN**2, OWN**2]])
    motions = DriveMotions(motions.steps, np.tile(np.linalg.inv(covariance), (COUNT, 1, 1)))
    fused = headings.fused(motions, closures)
    turned = fused.steps[:, 2] - motions.steps[:, 2]
    assert (turned < -0.0005).all()
    assert fused.steps[:, 1] == pytest.approx(0.5 * turned, rel=0.01)


def test_turns_across_forgotten_keyframes_and_without_odometry_are_unknown():
    scan, prior = LaserScan(0.0, 0.0, 0.1, 0.0, 10.0, np.ones(3)), np.diag([1.0, 1.0, 400.0])
    match = ScanMatch(SE2.identity(), 1.0, True, trust=0.25)
    odometry = [SE2(0.0, 0.0, 3.1), SE2(0.0, 0.0, -3.1), None, SE2.identity(), SE2.identity()]
    keyframes = [TrackedKeyframe.of(k, scan, SE2.identity(), match, prior, pose) for k, pose in enumerate(odometry)]
    headings = OdometryHeadings.of(keyframes)
    assert headings.turns[[0, 3]] == pytest.approx([2.0 * np.pi - 6.2, 0.0])
    assert headings.variances == pytest.approx([1 / 400, np.inf, np.inf, 1 / 400])
    assert headings.learnt == pytest.approx([1 / 1600, np.inf, np.inf, 1 / 1600])
    keyframes[4] = replace(keyframes[4], follows_gap=True)
    assert np.isinf(OdometryHeadings.of(keyframes).variances[1:]).all()
