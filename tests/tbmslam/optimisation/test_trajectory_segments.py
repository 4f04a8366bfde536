import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2, compose
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import ScanHits
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig, RigidStretches
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge, relative_pose
from tbmslam.sensing.laser_scan import LaserScan

CONFIG = AdjustmentConfig(stretch=1.0, turn=1.0)


def straight(count, step=0.3, y=0.0):
    return np.column_stack((np.arange(count) * step, np.full(count, y), np.zeros(count)))


def test_a_stretch_ends_after_a_metre_or_a_turn():
    poses = np.vstack((straight(8, 0.3), [[2.1, 0.0, theta] for theta in (0.6, 1.2, 1.8)]))
    stretches = RigidStretches(poses, [len(poses)], CONFIG)
    np.testing.assert_array_equal(stretches.owners, [0, 0, 0, 0, 1, 1, 1, 2, 2, 3, 3])
    np.testing.assert_array_equal(stretches.middles, [1, 5, 7, 9])
    np.testing.assert_allclose(compose(poses[stretches.middles][stretches.owners], stretches.places), poses, atol=1e-12)


def test_stretches_and_motions_do_not_reach_from_one_drive_into_another():
    poses = np.vstack((straight(7), straight(5, y=9.0), straight(1, y=-9.0)))
    stretches = RigidStretches(poses, [7, 5, 1], CONFIG)
    np.testing.assert_array_equal(stretches.owners, [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 3, 4])
    chains = [
        MotionChain.of([MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), np.eye(3) * 100.0) for k in range(*own)])
        for own in ((0, 6), (7, 11), (12, 12))
    ]
    between = stretches.between(chains)
    assert between.ends.tolist() == [[1, 5], [8, 11]]
    for (source, target), motion in zip(between.ends.tolist(), between.motions, strict=True):
        np.testing.assert_allclose(motion, relative_pose(poses, source, target), atol=1e-12)


def test_keyframes_follow_their_stretches():
    poses = np.vstack((straight(7), straight(5, y=9.0)))
    stretches = RigidStretches(poses, [7, 5], CONFIG)
    np.testing.assert_allclose(stretches.moved(poses[stretches.middles]), poses, atol=1e-12)
    shift = np.array([0.0, 0.5, 0.0])
    np.testing.assert_allclose(stretches.moved(poses[stretches.middles] + shift), poses + shift, atol=1e-12)


def test_hits_lie_in_the_frames_of_the_stretches_that_saw_them():
    poses = straight(6)
    scans = [LaserScan(0.1 * k, -0.5, 0.01, 0.1, 30.0, 4.0 / np.cos(-0.5 + 0.01 * np.arange(101))) for k in range(6)]
    drive = Keyframes.from_scans(scans, [SE2(*pose) for pose in poses], [SE2.identity()] * 6)
    stretches = RigidStretches(poses, [6], CONFIG)
    hits = stretches.hits([ScanHits.of(drive, 40.0)], CONFIG.model_copy(update={"hits": 25}))
    assert 6 * 25 <= len(hits.walls) + len(hits.loose) <= 6 * 30
    assert len(hits.walls) > 0.9 * 6 * 25
    for own, begins in ((hits.walls, hits.wall_begins), (hits.loose, hits.loose_begins)):
        assert begins.tolist() == [0, begins[1], len(own)]
        stretch = np.repeat([0, 1], np.diff(begins))
        keyframe = (poses[stretches.middles][stretch, 0] + own[:, 0] - 4.0) / 0.3
        np.testing.assert_array_equal(stretches.owners[np.rint(keyframe).astype(int)], stretch)
    np.testing.assert_allclose(np.abs(hits.walls[:, 2]), np.pi, atol=1e-5)


def test_hits_of_several_drives_lie_one_drive_after_the_other():
    poses = np.vstack((straight(4), straight(3, y=1.0)))
    scan = LaserScan(0.0, -0.5, 0.01, 0.1, 30.0, 4.0 / np.cos(-0.5 + 0.01 * np.arange(101)))
    drives = [
        ScanHits.of(Keyframes.from_scans([scan] * count, *[[SE2.identity()] * count] * 2), 40.0) for count in (4, 3)
    ]
    together = RigidStretches(poses, [4, 3], CONFIG).hits(drives, CONFIG)
    parts = [
        RigidStretches(own, [len(own)], CONFIG).hits([d], CONFIG)
        for own, d in zip((poses[:4], poses[4:]), drives, strict=True)
    ]
    for kind in ("walls", "loose"):
        np.testing.assert_array_equal(getattr(together, kind), np.vstack([getattr(part, kind) for part in parts]))
    first, second = (part.wall_begins for part in parts)
    np.testing.assert_array_equal(together.wall_begins, [*first, *(first[-1] + second[1:])])


def test_hits_too_far_away_are_left_out():
    poses = straight(2)
    scan = LaserScan(0.0, -0.5, 0.01, 0.1, 50.0, np.linspace(20.0, 40.0, 101))
    drive = ScanHits.of(Keyframes.from_scans([scan] * 2, *[[SE2.identity()] * 2] * 2), 40.0)
    hits = RigidStretches(poses, [2], CONFIG).hits([drive], CONFIG)
    assert len(hits.walls) + len(hits.loose) == 2 * 51


@pytest.mark.parametrize("counts", [[1], [1, 1]])
def test_a_drive_of_one_keyframe_is_one_stretch(counts):
    poses = straight(len(counts))
    stretches = RigidStretches(poses, counts, CONFIG)
    assert len(stretches.middles) == len(counts)
    assert stretches.between([MotionChain.of([]) for _ in counts]).ends.shape == (0, 2)


def test_the_hits_must_be_of_as_many_drives():
    poses = np.vstack((straight(7), straight(5, y=9.0)))
    scans = [LaserScan(0.1 * k, -0.5, 0.01, 0.1, 30.0, np.full(101, 4.0)) for k in range(7)]
    drive = Keyframes.from_scans(scans, [SE2(*pose) for pose in poses[:7]], [SE2.identity()] * 7)
    with pytest.raises(ValueError, match="longer"):
        RigidStretches(poses, [7, 5], CONFIG).hits([ScanHits.of(drive, 40.0)], CONFIG)
