import math

import numpy as np

from tbmslam.laser_scan import LaserScan, Reading
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
