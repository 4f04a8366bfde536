import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import DriveHits, ScanHits
from tbmslam.optimisation.pose_graph import relative_pose
from tbmslam.sensing.laser_scan import LaserScan


def test_they_are_the_hits_of_each_scan(generator):
    ranges = generator.uniform(1.0, 6.0, (5, 50))
    ranges[generator.random((5, 50)) < 0.2] = np.nan
    scans = [LaserScan(float(k), -1.0, 0.04, 0.1, 10.0, row) for k, row in enumerate(ranges)]
    keyframes = Keyframes.from_scans(scans, *[[SE2.identity()] * 5] * 2)
    hits = ScanHits.of(keyframes, 5.0)
    assert len(hits) == 5
    for k, scan in enumerate(scans):
        own, expected = slice(hits.offsets[k], hits.offsets[k + 1]), scan.hits(5.0)
        np.testing.assert_allclose(hits.points[own], expected.points, atol=1e-5)
        np.testing.assert_allclose(hits.normals[own], expected.normals, atol=1e-4)
    assert hits.offsets[-1] == len(hits.points) == len(hits.normals)


@pytest.fixture
def scans(generator):
    ranges = generator.uniform(1.0, 6.0, (30, 50))
    ranges[generator.random((30, 50)) < 0.2] = np.nan
    return [LaserScan(float(k), -1.0, 0.04, 0.1, 10.0, row) for k, row in enumerate(ranges)]


@pytest.fixture
def poses(generator):
    return np.cumsum(generator.uniform(0.0, 0.3, (30, 3)), axis=0)


def packed(scans):
    return ScanHits.of(Keyframes.from_scans(scans, *[[SE2.identity()] * len(scans)] * 2), 5.0)


@pytest.mark.parametrize("step", [0.7, 2.5])
def test_stops_are_a_step_apart(scans, poses, step):
    drive = DriveHits(packed(scans), poses)
    stops = drive.stops(step)
    apart = np.diff(drive.travelled[stops])
    assert stops[0] == 0
    assert step - 0.5 <= apart.min() <= apart.max() <= step + 0.5


def test_bundles_are_the_hits_of_the_keyframes_around(scans, poses):
    drive = DriveHits(packed(scans), poses)
    near = np.flatnonzero(np.abs(drive.travelled - drive.travelled[12]) <= 1.0)
    each = [(scans[k].hits(5.0), relative_pose(poses, 12, k)) for k in (12, *near)]
    points = np.vstack([pose.apply(hits.points) for hits, pose in each])
    normals = np.vstack([SE2(0.0, 0.0, pose.theta).apply(hits.normals) for hits, pose in each])
    bundle = drive.bundle(12, 1.0, 10_000)
    np.testing.assert_allclose(bundle.points, points, atol=1e-5)
    np.testing.assert_allclose(bundle.normals, normals, atol=1e-5)
    assert 60 <= len(drive.bundle(12, 1.0, 60).points) < 120


def test_no_bundle_extends_over_a_break(scans, poses):
    plain, broken = (DriveHits(packed(scans), poses, breaks, 16.0) for breaks in (None, np.array([12])))
    np.testing.assert_allclose(broken.travelled - plain.travelled, [0.0] * 12 + [16.0] * 18, atol=1e-9)
    own = len(scans[12].hits(5.0).points)
    reach = max(plain.travelled[12] - plain.travelled[11], plain.travelled[13] - plain.travelled[12]) + 1e-6
    before, after = (len(drive.bundle(12, reach, 10_000).points) - own for drive in (plain, broken))
    assert before - after >= len(scans[11].hits(5.0).points)


def test_begins_are_where_each_keyframe_begins(scans, poses):
    drive = DriveHits(packed(scans), poses)
    chosen = np.array([3, 9])
    begins = drive.begins(chosen)
    assert begins.tolist() == [0, len(scans[3].hits(5.0).points), len(drive.placed(chosen, 12).points)]
    alone = drive.placed(chosen[1:], 3)
    np.testing.assert_array_equal(drive.placed(chosen, 3).points[begins[1] :], alone.points)


def test_scans_and_poses_must_agree(scans, poses):
    with pytest.raises(ValueError, match="scans must be as many as poses, got 30 and 29"):
        DriveHits(packed(scans), poses[1:])
