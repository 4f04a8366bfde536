import math

import numpy as np

from tbmslam.laser_scan import Hits, LaserScan, Reading
from tbmslam.se2 import SE2


def scan(ranges, angle_min=-math.pi / 2, increment=math.pi / 2):
    return LaserScan(5.0, angle_min, increment, 0.1, 30.0, np.array(ranges, dtype=np.float64))


def test_beams_point_where_the_first_angle_and_the_step_say():
    np.testing.assert_allclose(scan([1.0, 1.0, 1.0]).angles(), [-math.pi / 2, 0.0, math.pi / 2])


def test_an_upside_down_laser_turns_the_other_way():
    np.testing.assert_allclose(scan([1.0, 1.0], math.pi / 2, -math.pi).angles(), [math.pi / 2, -math.pi / 2])


def test_only_finite_ranges_hit():
    np.testing.assert_array_equal(scan([1.0, np.inf, np.nan, 2.0]).is_hit(), [True, False, False, True])


def test_hit_points_lie_where_beams_end():
    points = scan([1.0, np.nan, 3.0, np.inf]).hit_points()
    np.testing.assert_allclose(points, [[0.0, -1.0], [0.0, 3.0]], atol=1e-15)


def test_a_scan_without_hits_has_no_points():
    assert scan([np.inf, np.nan]).hit_points().shape == (0, 2)
    assert scan([]).hit_points().shape == (0, 2)


def test_a_reading_s_laser_sits_at_the_centre_unless_told():
    assert Reading(scan([1.0]), None).T_robot_sensor == SE2.identity()


def scan_of(ranges, angle_min=-1.0, step=0.02):
    return LaserScan(0.0, angle_min, step, 0.1, 30.0, np.asarray(ranges, dtype=np.float64))


def test_normals_stand_on_the_wall_and_face_the_laser():
    angles = -1.0 + 0.02 * np.arange(101)
    hits = scan_of(2.0 / np.cos(angles)).hits()
    np.testing.assert_allclose(hits.normals, np.tile([-1.0, 0.0], (101, 1)), atol=1e-9)


def test_a_lonely_hit_faces_the_laser():
    ranges = np.full(101, np.nan)
    ranges[[20, 80]] = 5.0
    hits = scan_of(ranges).hits()
    np.testing.assert_allclose(hits.normals, -hits.points / 5.0, atol=1e-9)


def test_hits_are_limited_placed_joined_and_thinned():
    scan = scan_of(np.linspace(1.0, 11.0, 101))
    hits = scan.hits(6.0)
    assert len(hits.points) == 51
    moved = hits.placed(SE2(1.0, 2.0, np.pi / 2))
    np.testing.assert_allclose(moved.points, SE2(1.0, 2.0, np.pi / 2).apply(hits.points))
    np.testing.assert_allclose(moved.normals[:, 0], -hits.normals[:, 1], atol=1e-12)
    both = Hits.joined([hits, moved])
    assert both.points.shape == both.normals.shape == (102, 2)
    assert len(both.thinned(20).points) == 21
    assert len(both.thinned(1000).points) == 102
    assert len(scan_of([np.nan, np.inf]).hits().points) == 0
