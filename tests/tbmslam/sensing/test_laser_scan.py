import math
from dataclasses import replace

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.slam import Slam


def scan(ranges, angle_min=-math.pi / 2, increment=math.pi / 2):
    return LaserScan(5.0, angle_min, increment, 0.1, 30.0, np.array(ranges, dtype=np.float64))


def test_beams_point_where_the_first_angle_and_the_step_say():
    np.testing.assert_allclose(scan([1.0, 1.0, 1.0]).hit_points(), [[0.0, -1.0], [1.0, 0.0], [0.0, 1.0]], atol=1e-12)


def test_an_upside_down_laser_turns_the_other_way():
    points = scan([1.0, 1.0], math.pi / 2, -math.pi).hit_points()
    np.testing.assert_allclose(points, [[0.0, 1.0], [0.0, -1.0]], atol=1e-12)


def test_backwards_the_beams_stay_where_they_are():
    forwards = scan([1.0, np.inf, 2.0, 3.0])
    backwards = forwards.backwards()
    np.testing.assert_allclose(backwards.hit_points(), forwards.hit_points()[::-1], atol=1e-12)
    assert backwards.ranges.flags["C_CONTIGUOUS"]
    assert backwards.backwards().angle_min == pytest.approx(forwards.angle_min)


def test_only_finite_ranges_hit():
    np.testing.assert_array_equal(scan([1.0, np.inf, np.nan, 2.0]).is_hit(), [True, False, False, True])


def test_hit_points_lie_where_beams_end():
    points = scan([1.0, np.nan, 3.0, np.inf]).hit_points()
    np.testing.assert_allclose(points, [[0.0, -1.0], [0.0, 3.0]], atol=1e-15)


def test_a_scan_without_hits_has_no_points():
    assert scan([np.inf, np.nan]).hit_points().shape == (0, 2)
    assert scan([]).hit_points().shape == (0, 2)


def test_the_default_mount_is_the_centre():
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


def test_hits_are_limited_and_thinned():
    scan = scan_of(np.linspace(1.0, 11.0, 101))
    hits = scan.hits(6.0)
    assert len(hits.points) == 51
    assert len(hits.thinned(10).points) == 11
    assert len(hits.thinned(1000).points) == 51
    assert len(scan_of([np.nan, np.inf]).hits().points) == 0


@pytest.mark.parametrize("pose", [SE2(math.nan, 0.0, 0.0), SE2(0.0, math.inf, 0.0), SE2(0.0, 0.0, -1e300)])
@pytest.mark.parametrize("name", ["T_odom_robot", "T_robot_sensor", "T_odom_swept"])
def test_poses_that_compiled_code_cannot_take_are_refused(name, pose):
    poses = {"T_odom_robot": SE2(5e6, 4e5, 1.0), name: pose}
    with pytest.raises(ValueError, match=rf"{name} must be finite and within 1e\+08 m, got SE2"):
        Slam().process(Reading(scan([1.0, 2.0]), **poses))


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["stamp", "angle_min", "angle_increment", "range_min", "time_increment"])
def test_numbers_of_a_scan_that_are_not_finite_are_refused(name, wrong):
    bad = replace(scan([1.0, 2.0, 3.0]), **{name: wrong})
    with pytest.raises(ValueError, match=f"range_min and time_increment must be finite, got .*{wrong}"):
        Slam().process(Reading(bad, None))


def test_a_beam_step_that_compiled_code_cannot_take_is_refused():
    bad = replace(scan([1.0, 2.0]), beam_step=SE2(0.0, math.nan, 0.0))
    with pytest.raises(ValueError, match=r"beam_step must be finite and within 1e\+08 m, got SE2"):
        Slam().process(Reading(bad, None))


def test_a_largest_range_may_be_infinite_but_not_nan():
    unlimited = replace(scan([1.0, 2.0]), range_max=math.inf)
    Reading(unlimited, None).check()
    with pytest.raises(ValueError, match="range_max must be a number, got nan"):
        Slam().process(Reading(replace(unlimited, range_max=math.nan), None))


@pytest.mark.parametrize("wrong", [-1.5, -math.inf])
def test_negative_ranges_are_refused(wrong):
    bad = LaserScan(0.0, 0.0, 0.1, 0.1, 30.0, np.array([1.0, math.nan, math.inf, wrong]))
    with pytest.raises(ValueError, match=f"ranges must not be negative, got {wrong}: nan means unknown"):
        Slam().process(Reading(bad, None))


def test_beams_that_all_point_one_way_are_refused_but_for_a_single_one():
    for step in (0.0, -0.0):
        bad = LaserScan(0.0, 0.0, step, 0.1, 30.0, np.ones(7))
        with pytest.raises(ValueError, match="angle_increment must not be 0 with more than one beam, got 0 and 7"):
            Slam().process(Reading(bad, None))
    for ranges in (np.ones(1), np.ones(0)):
        Reading(LaserScan(0.0, 0.0, 0.0, 0.1, 30.0, ranges), None).check()
