import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive, DriveMotions, spread_corrections, with_keyframes_at
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan


@pytest.fixture
def poses():
    return np.column_stack((np.arange(11.0), np.zeros(11), np.full(11, 0.3)))


def test_anchors_go_where_they_are_put_and_the_rest_follows(poses):
    anchors = np.array([2, 6])
    targets = poses[anchors] + [[0.0, 1.0, 0.0], [0.0, 3.0, 0.0]]
    moved = spread_corrections(poses, anchors, targets)
    np.testing.assert_allclose(moved[anchors], targets, atol=1e-12)
    np.testing.assert_allclose(moved[:3, 1], 1.0)
    np.testing.assert_allclose(moved[3:6, 1], [1.5, 2.0, 2.5])
    np.testing.assert_allclose(moved[6:, 1], 3.0)


def test_a_rigid_correction_moves_all_poses_equally(poses):
    T_new_old = SE2(1.0, -2.0, 0.7)
    anchors = np.array([0, 5, 10])
    targets = np.array([T_new_old @ SE2.from_array(pose) for pose in poses[anchors]])
    expected = np.array([T_new_old @ SE2.from_array(pose) for pose in poses])
    np.testing.assert_allclose(spread_corrections(poses, anchors, targets), expected, atol=1e-12)


def test_without_anchors_nothing_moves(poses):
    moved = spread_corrections(poses, np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    np.testing.assert_array_equal(moved, poses)
    assert moved is not poses


def test_a_trajectory_follows_its_keyframes(poses):
    scans = [LaserScan(stamp, 0.0, 0.1, 0.1, 9.0, np.ones(2)) for stamp in (2.0, 6.0)]
    keyframes = Keyframes.from_scans(scans, [SE2.from_array(poses[k]) for k in (2, 6)], [SE2.identity()] * 2, [2, 6])
    drive = Drive("robot", Trajectory(np.arange(11.0), poses), keyframes)
    targets = keyframes.poses + np.array([[0.0, 1.0, 0.0], [0.0, 3.0, 0.0]])
    moved = with_keyframes_at(drive, targets)
    np.testing.assert_allclose(moved.keyframes.poses, targets)
    np.testing.assert_allclose(moved.trajectory.poses[[2, 6]], targets)
    np.testing.assert_allclose(moved.trajectory.poses[4], poses[4] + [0.0, 2.0, 0.0])
    np.testing.assert_array_equal(moved.trajectory.stamps, drive.trajectory.stamps)


def test_keyframes_of_a_drive_without_a_trajectory_are_corrected(poses):
    keyframes = Keyframes.from_scans(
        [LaserScan(0.0, 0.0, 0.1, 0.1, 9.0, np.ones(2))], [SE2.identity()], [SE2.identity()]
    )
    drive = Drive("robot", Trajectory(np.zeros(0), np.zeros((0, 3))), keyframes)
    assert with_keyframes_at(drive, poses[3:4]).keyframes.poses.tolist() == poses[3:4].tolist()


@given(
    st.lists(st.sampled_from([0.1, 0.0, -0.2, -5.0, -30.0, 40.0]), min_size=4, max_size=60),
    st.data(),
    st.integers(0, 99),
)
def test_the_trajectory_passes_its_keyframes_for_any_stamps(steps, data, seed):
    generator, stamps = np.random.default_rng(seed), np.cumsum(steps)
    poses, targets = (generator.uniform(-3.0, 3.0, (len(steps), 3)) for _ in range(2))
    chosen = sorted(data.draw(st.sets(st.integers(0, len(steps) - 1), min_size=1)))
    scans = [LaserScan(stamps[k], 0.0, 0.1, 0.1, 9.0, np.ones(2)) for k in chosen]
    keyframes = Keyframes.from_scans(
        scans, [SE2.from_array(poses[k]) for k in chosen], [SE2.identity()] * len(chosen), chosen
    )
    moved = with_keyframes_at(Drive("robot", Trajectory(stamps, poses), keyframes), targets[chosen])
    np.testing.assert_array_equal(moved.trajectory.poses[chosen], targets[chosen])
    np.testing.assert_array_equal(moved.keyframes.poses, targets[chosen])
    np.testing.assert_array_equal(moved.trajectory.stamps, stamps)


def test_what_lies_between_keyframes_follows_them_where_stamps_step_back(poses):
    """Twice over the same stamps: looked up by stamp, the second keyframe would be taken for the first half's."""
    stamps = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    scans = [LaserScan(stamps[k], 0.0, 0.1, 0.1, 9.0, np.ones(2)) for k in (2, 6)]
    keyframes = Keyframes.from_scans(scans, [SE2.from_array(poses[k]) for k in (2, 6)], [SE2.identity()] * 2, [2, 6])
    targets = keyframes.poses + np.array([[0.0, 1.0, 0.0], [0.0, 3.0, 0.0]])
    moved = with_keyframes_at(Drive("robot", Trajectory(stamps, poses), keyframes), targets)
    np.testing.assert_allclose((moved.trajectory.poses - poses)[:, 1], [1, 1, 1, 1.5, 2, 2.5, 3, 3, 3, 3, 3])


def test_a_drive_and_its_parts_are_shown_in_one_line_each(poses):
    scans = [LaserScan(stamp, 0.0, 0.1, 0.1, 9.0, np.ones(3)) for stamp in (2.0, 6.0)]
    keyframes = Keyframes.from_scans(scans, [SE2.from_array(poses[k]) for k in (2, 6)], [SE2.identity()] * 2, [2, 6])
    motions = DriveMotions(np.array([[4.0, 0.0, 0.0]]), np.eye(3)[None])
    drive = Drive("robot", Trajectory(np.arange(11.0), poses), keyframes, motions=motions)
    assert repr(drive) == "Drive('robot', 11 poses, 2 keyframes)"
    assert repr(drive.trajectory) == "Trajectory(11 poses, 10.0 m)"
    assert repr(drive.keyframes) == "Keyframes(2 scans, 6 beams)"
    assert repr(drive.motions) == "DriveMotions(1 steps)"
