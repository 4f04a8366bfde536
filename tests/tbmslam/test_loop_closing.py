import numpy as np
import pytest

from tbmslam.keyframes import Keyframes
from tbmslam.laser_scan import LaserScan
from tbmslam.loop_closing import LoopCloser, LoopClosingConfig
from tbmslam.pose_graph import MotionEdge, relative_pose
from tbmslam.se2 import SE2
from tbmslam.slam import Slam
from tbmslam.surfel_map import SurfelConfig

INFORMATION = np.diag([0.004**-2, 0.004**-2, 0.002**-2])


def drifting_keyframes(robot, drift_per_metre):
    """Return true and drifting laser poses of a keyframe every 0.4 m, their scans and the motions between them."""
    true = [robot.truth.pose(k) @ r.T_robot_sensor for k, r in enumerate(robot.readings)]
    kept = [0]
    for k, pose in enumerate(true):
        step = true[kept[-1]].inverse() @ pose
        if np.hypot(step.x, step.y) > 0.4 or abs(step.theta) > 0.3:
            kept.append(k)
    true = np.array([true[k] for k in kept])
    tracked = [SE2.from_array(true[0])]
    for k in range(1, len(true)):
        step = relative_pose(true, k - 1, k)
        tracked.append(tracked[-1] @ SE2(step.x, step.y, step.theta + drift_per_metre * np.hypot(step.x, step.y)))
    tracked = np.array(tracked)
    chain = [MotionEdge(k, k + 1, relative_pose(tracked, k, k + 1), INFORMATION) for k in range(len(tracked) - 1)]
    return true, tracked, packed([robot.readings[k].scan for k in kept]), chain


def packed(scans):
    return Keyframes.from_scans(scans, *[[SE2.identity()] * len(scans)] * 2)


def errors(true, poses):
    return np.hypot(*(poses - true)[:, :2].T)


@pytest.mark.parametrize(("world", "left"), [("apartment", 0.5), ("office", 0.1), ("store", 0.25)])
def test_a_drifting_drive_is_bent_back(drive_in, world, left):
    true, tracked, scans, chain = drifting_keyframes(drive_in(world, None, seed=1), 0.001)
    closed, closures = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(tracked, scans, chain)
    assert len(closures) > 5
    assert errors(true, closed).max() < left * errors(true, tracked).max()
    for edge in closures:
        error = relative_pose(true, edge.source, edge.target).inverse() @ edge.T_source_target
        covariance = np.linalg.inv(edge.information)
        assert np.array(error[:2]) @ np.linalg.inv(covariance[:2, :2]) @ np.array(error[:2]) < 6.0**2


def test_a_self_similar_corridor_closes_nothing_false(drive_in):
    true, tracked, scans, chain = drifting_keyframes(drive_in("corridor", 80.0, seed=1), 0.0)
    closed, _ = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(tracked, scans, chain)
    assert errors(true, closed).max() < 0.1


def test_a_drive_that_never_comes_back_stays_as_it_is():
    poses = np.column_stack((np.arange(0.0, 30.0, 0.5), np.zeros(60), np.zeros(60)))
    scans = [LaserScan(float(k), -1.5, 0.05, 0.1, 20.0, np.full(60, 2.0 + 0.01 * k)) for k in range(60)]
    chain = [MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), INFORMATION) for k in range(59)]
    closed, closures = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(poses, packed(scans), chain)
    assert closures == []
    np.testing.assert_array_equal(closed, poses)


def test_few_submaps_are_kept_at_a_time(drive_in, monkeypatch):
    """Forgotten ones are built anew and give the same poses."""
    robot = drive_in("apartment", 60.0)
    slam = Slam()
    for reading in robot.readings:
        slam.process(reading)
    expected = slam.finish().drives[0]
    monkeypatch.setattr("tbmslam.closing_targets._SUBMAPS_KEPT", 1)
    found = slam.finish().drives[0]
    assert len(expected.closures) > 0
    np.testing.assert_array_equal(found.closures, expected.closures)
    np.testing.assert_array_equal(found.trajectory.poses, expected.trajectory.poses)
