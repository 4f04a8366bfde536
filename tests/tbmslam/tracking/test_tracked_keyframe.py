from dataclasses import fields

import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, chain, motions, odometry, packed
from tbmslam.tracking.tracker import ScanMatch

SCAN = LaserScan(0.0, 0.0, 0.1, 0.1, 9.0, np.ones(3))


def keyframe(pose, information, variances):
    match = ScanMatch(pose, 0.9, moved=True, information=information)
    return TrackedKeyframe.of(0, SCAN, SE2.identity(), match, np.diag(1.0 / np.array(variances)))


def test_a_step_knows_what_surfaces_and_odometry_know():
    """Surfaces that only tell y in the map leave x to the odometry; in the turned keyframe's frame both swap."""
    before = keyframe(SE2(1.0, 2.0, np.pi / 2), None, [1.0, 1.0, 1.0])
    after = keyframe(SE2(1.0, 2.5, np.pi / 2), np.diag([0.0, 1e6, 1e4]), [0.01, 0.01, 0.04])
    (edge,) = chain(motions([before, after]))
    np.testing.assert_allclose(edge.T_source_target, (0.5, 0.0, 0.0), atol=1e-12)
    covariance = np.linalg.inv(edge.information)
    floor = 0.004**2
    np.testing.assert_allclose(covariance[0, 0], 1.0 / (1e6 + 100.0) + floor)
    np.testing.assert_allclose(covariance[1, 1], 0.01 + floor)
    np.testing.assert_allclose(covariance[2, 2], 1.0 / (1e4 + 25.0) + 0.001**2)


def test_one_keyframe_has_no_steps():
    assert chain(motions([keyframe(SE2.identity(), None, [1.0, 1.0, 1.0])])) == []


def test_a_drive_in_a_larger_graph_begins_at_its_first_pose():
    three = [keyframe(SE2(x, 0.0, 0.0), None, [1.0, 1.0, 1.0]) for x in (0.0, 1.0, 2.0)]
    assert [(edge.source, edge.target) for edge in chain(motions(three), 7)] == [(7, 8), (8, 9)]


def test_scans_are_kept_in_half_the_memory():
    scan = LaserScan(1.0, -1.0, 0.1, 0.1, 9.0, np.array([1.5, np.inf, np.nan, 0.1]), 0.01, SE2(0.0, 0.1, 0.2))
    match = ScanMatch(SE2.identity(), 0.9, moved=True)
    kept = [TrackedKeyframe.of(index, scan, SE2.identity(), match, np.eye(3)) for index in range(3)]
    assert kept[0].ranges.nbytes == scan.ranges.nbytes // 2
    again = kept[0].scan
    assert again.ranges.dtype == np.float64
    np.testing.assert_allclose(again.ranges, scan.ranges, rtol=1e-7)
    assert (again.stamp, again.beam_step, again.time_increment) == (1.0, scan.beam_step, 0.01)


def test_keyframes_are_packed_as_scans_are(generator):
    match = ScanMatch(SE2.identity(), 0.9, moved=True)
    scans = [LaserScan(k, -1.0, 0.1, 0.1, 9.0, generator.uniform(size=3 + k), 0.01, SE2(0, 0, k)) for k in range(4)]
    poses, mount = [SE2(k, 1.0, 0.5) for k in range(4)], SE2(0.3, 0.0, 1.0)
    kept = [TrackedKeyframe.of(3 * k, scan, mount, match, np.eye(3)) for k, scan in enumerate(scans)]
    found, expected = packed(kept, np.array(poses)), Keyframes.from_scans(scans, poses, [mount] * 4, [0, 3, 6, 9])
    for field in fields(Keyframes):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name))
    assert len(packed([], np.zeros((0, 3)))) == 0


def test_the_odometry_goes_along_with_its_keyframe():
    match, places = ScanMatch(SE2.identity(), 0.9, moved=True), [SE2(1.0, 2.0, 0.5), None, SE2.identity()]
    kept = [TrackedKeyframe.of(k, SCAN, SE2.identity(), match, np.eye(3), place) for k, place in enumerate(places)]
    kept[0] = kept[0].moved(SE2(5.0, 0.0, 1.0)).with_scan(SCAN.with_ranges(np.full(3, 2.0)))
    np.testing.assert_array_equal(odometry(kept), [(1.0, 2.0, 0.5), (np.nan,) * 3, (0.0, 0.0, 0.0)])
    assert odometry([]).shape == (0, 3)


def test_other_ranges_change_nothing_else():
    before = TrackedKeyframe.of(4, SCAN, SE2(0.3, 0.0, 0.0), ScanMatch(SE2.identity(), 0.9, moved=True), np.eye(3))
    after = before.with_scan(SCAN.with_ranges(np.array([1.0, np.nan, 2.0])))
    np.testing.assert_array_equal(after.scan.ranges, [1.0, np.nan, 2.0])
    assert after.ranges.dtype == np.float32
    assert (after.index, after.T_robot_sensor, after.match) == (4, before.T_robot_sensor, before.match)


def test_a_keyframe_moves_with_all_that_is_known_of_it():
    known, prior = np.diag([1e4, 1.0, 1e3]), np.diag([2.0, 50.0, 9.0])
    match = ScanMatch(SE2(1.0, 0.0, 0.0), 0.9, moved=True, information=known)
    moved = TrackedKeyframe.of(0, SCAN, SE2.identity(), match, prior).moved(SE2(0.0, 2.0, np.pi / 2))
    np.testing.assert_allclose(moved.match.T_map_sensor, (0.0, 3.0, np.pi / 2), atol=1e-9)
    np.testing.assert_allclose(moved.match.information, np.diag([1.0, 1e4, 1e3]), atol=1e-9)
    np.testing.assert_allclose(moved.prior, np.diag([50.0, 2.0, 9.0]), atol=1e-9)
