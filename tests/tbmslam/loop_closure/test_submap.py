import itertools

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.search.correlation import WALL
from tbmslam.loop_closure.submap import (
    Submap,
    SubmapConfig,
    _search_field,
    open_direction,
    split_into_submaps,
    without_open_direction,
)
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import DriveHits, ScanHits
from tbmslam.tracking.surfel_map import SurfelConfig


@pytest.fixture(scope="module")
def submap(drive_in):
    """A submap of the first metres of a drive, and the drive's later scans with their true poses in its frame."""
    robot = drive_in("apartment", 30.0)
    sensor_poses = np.array([robot.truth.pose(k) @ r.T_robot_sensor for k, r in enumerate(robot.readings)])
    keyframes = list(range(0, 60, 3))
    scans = [robot.readings[k].scan for k in keyframes]
    packed = Keyframes.from_scans(scans, *[[SE2.identity()] * len(scans)] * 2)
    drive = DriveHits(ScanHits.of(packed, 40.0), sensor_poses[keyframes])
    made = Submap(0, len(keyframes) - 1, drive, SubmapConfig(), SurfelConfig())
    T_anchor_world = SE2.from_array(sensor_poses[keyframes[made.anchor]]).inverse()
    later = 31
    return made, robot.readings[later].scan.hits(), T_anchor_world @ SE2.from_array(sensor_poses[later])


def test_a_search_finds_the_place(submap):
    made, hits, true = submap
    guess = SE2(true.x + 1.0, true.y - 0.8, true.theta + 0.2)
    found = made.search(hits.points, guess, 2.0, 0.3)
    assert np.hypot(found.pose.x - true.x, found.pose.y - true.y) < 0.3
    assert abs(found.pose.theta - true.theta) < 0.03
    assert not found.at_border
    assert 0.8 < found.score <= 1.0
    fit = made.fit(hits, found.pose)
    assert np.hypot(fit.pose.x - true.x, fit.pose.y - true.y) < 0.02
    assert fit.matched > 0.8
    assert fit.violated < 0.05


def test_the_score_of_a_search_tells_how_many_hits_can_lie_on_walls(submap):
    made, hits, true = submap
    there = made.search(hits.points, true, 0.3, 0.03)
    astray = hits.points.copy()
    astray[: len(astray) // 2] += 100.0  # in unknown space
    half = made.search(astray, true, 0.3, 0.03)
    assert half.score == pytest.approx(0.5 * there.score, abs=0.1)
    assert made.search(hits.points + 100.0, true, 0.3, 0.03).score <= 0.0


def test_the_places_of_a_search_begin_with_the_best(submap):
    made, hits, true = submap
    guess = SE2(true.x + 1.0, true.y - 0.8, true.theta + 0.2)
    places = made.places(hits.points, guess, 4.0, 0.3, 4)
    assert places[0] == made.search(hits.points, guess, 4.0, 0.3).pose
    assert 2 <= len(places) <= 4
    for one, other in itertools.combinations(places, 2):
        assert max(abs(one.x - other.x), abs(one.y - other.y)) > 0.8
    assert made.places(hits.points, SE2(true.x + 0.8, true.y, true.theta), 0.6, 0.0, 1) == []


def test_a_wrong_place_lies_in_free_space(submap):
    made, hits, true = submap
    fit = made.fit(hits, SE2(true.x + 1.5, true.y, true.theta + 0.8))
    assert fit.matched < 0.4
    assert fit.violated > 0.2 * fit.matched


def test_the_border_of_a_search_is_told(submap):
    made, hits, true = submap
    assert made.search(hits.points, SE2(true.x + 0.8, true.y, true.theta), 0.6, 0.0).at_border


def test_a_search_where_nothing_is_known_is_ambiguous(submap):
    made, hits, true = submap
    far = SE2(true.x + 500.0, true.y, true.theta)
    assert made.search(hits.points, far, 1.0, 0.1).ambiguity == 1.0


def test_points_gain_where_the_scans_hit(generator):
    """Every end and what is next to it, out to the borders, and nothing far from them."""
    lasers, ends = np.zeros((2, 3)), generator.uniform((-3.0, -2.0), (1.0, 4.0), (60, 2))
    field, lattice = _search_field(lasers, ends, np.array([0, 30, 60]), SubmapConfig())
    cells = np.floor(ends / lattice.resolution).astype(int)[:, ::-1] - (lattice.first_row, lattice.first_col)
    expected = np.zeros(field.shape, dtype=bool)
    for row, col in cells:
        expected[row - 1 : row + 2, col - 1 : col + 2] = True
    np.testing.assert_array_equal(field == WALL, expected)


def test_stretches_overlap_by_half():
    poses = np.column_stack((np.arange(0.0, 40.1, 0.5), np.zeros(81), np.zeros(81)))
    stretches = split_into_submaps(poses[:, 0], 8.0)
    assert stretches[0][0] == 0
    assert stretches[-1][1] == 80
    lengths = [poses[last, 0] - poses[first, 0] for first, last in stretches]
    assert max(lengths) <= 8.0
    assert all(later[0] <= earlier[1] for earlier, later in itertools.pairwise(stretches))


def test_no_stretch_extends_over_a_break():
    travelled = np.arange(0.0, 40.1, 0.5) + 16.0 * (np.arange(81) >= 31)
    stretches = split_into_submaps(travelled, 8.0)
    assert all((first < 31) == (last < 31) for first, last in stretches)
    assert {k for first, last in stretches for k in range(first, last + 1)} == set(range(81))


def test_a_short_drive_is_one_submap():
    assert split_into_submaps(np.zeros(3), 8.0) == [(0, 2)]


def test_an_undetermined_direction_has_no_information():
    turn = SE2(0.0, 0.0, 0.4).matrix()
    open_along, shut = (turn @ np.diag([along, 1e6, 1e5]) @ turn.T for along in (10.0, 5e5))
    assert open_direction(shut, 0.02) is None
    np.testing.assert_array_equal(without_open_direction(shut, 0.02), shut)
    direction = open_direction(open_along, 0.02)
    np.testing.assert_allclose(abs(direction @ turn[:2, 0]), 1.0)
    kept = without_open_direction(open_along, 0.02)
    np.testing.assert_allclose(turn.T @ kept @ turn, np.diag([0.0, 1e6, 1e5]), atol=1e-6)
