"""Parts of the robot in view are told from what stands in the world, without turning."""

import math

import numpy as np
import pytest

from tbmslam.kernels.ray_casting import cast_rays
from tbmslam.laser_scan import LaserScan
from tbmslam.monitoring.parts_in_view import PartsInView, PartsInViewConfig
from tbmslam.se2 import SE2

BEAMS, FIRST = 361, -0.75 * math.pi
STEP = 1.5 * math.pi / (BEAMS - 1)
ANGLES = FIRST + STEP * np.arange(BEAMS)
EVEN = [(-10.0, -0.9, 70.0, -0.9), (-10.0, 0.9, 70.0, 0.9), (70.0, -0.9, 70.0, 0.9), (-10.0, -0.9, -10.0, 0.9)]
NOISE = 0.01


def post(bearing_deg, distance, radius=0.04):
    """Return the sides of a round thing, seen from the laser."""
    middle = distance * np.array((math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg))))
    around = np.arange(9) * math.pi / 4.0
    corners = middle + radius * np.stack((np.cos(around), np.sin(around)), axis=1)
    return [tuple(side) for side in np.hstack((corners[:-1], corners[1:]))]


def seen(walls, pose):
    ranges = np.empty((1, BEAMS))
    cast_rays(np.array(walls), np.array([pose]), FIRST, STEP, 30.0, ranges)
    return ranges[0]


def drive(
    parts=(),
    length=8.0,
    walls=EVEN,
    wobble=0.0,
    y=0.0,
    shaking=0.0,
    odometry=True,
    seed=0,
    during=(0, 10**6),
    forget=(-1, 0.0),
):
    """Drive along x in steps of a tenth of a metre with parts (seen from the laser) in view.

    After the step `forget[0]`, what was seen before `forget[1]` is forgotten.
    """
    rng, watched = np.random.default_rng(seed), PartsInView(PartsInViewConfig())
    scans = []
    for k in range(round(10 * length) + 1):
        pose = SE2(0.1 * k, y, wobble * math.sin(0.2 * k))
        ranges = seen(walls, pose)
        if len(parts) and during[0] <= k < during[1]:
            shaken = np.array(parts) + np.tile(rng.normal(0.0, 1.0, 2) * shaking, 2)
            ranges = np.minimum(ranges, seen(shaken, SE2.identity()))
        scan = LaserScan(float(k), FIRST, STEP, 0.02, 30.0, ranges + rng.normal(0.0, NOISE, BEAMS))
        scans.append(scan)
        watched.look(scan, pose, pose if odometry else None)
        if k == forget[0]:
            watched.forget(forget[1])
    return watched, scans


def on(parts):
    """Return which beams end on parts."""
    return seen(parts, SE2.identity()) < 20.0


POSTS = [*post(-60.0, 0.3), *post(75.0, 0.5)]


@pytest.mark.parametrize(
    "parts",
    [
        POSTS,
        [*post(-110.0, 0.15, 0.03), *post(120.0, 0.6)],
        [(-0.1, 0.4, 0.35, 0.4)],  # a flank
        [(-0.35, 0.2, -0.2, 0.4), *post(-125.0, 0.35)],
        post(0.0, 0.3, 0.02),  # nobody sees through the place behind it, but the laser drives by way of it
        post(15.0, 1.8, 0.1),
    ],
)
def test_parts_are_found_on_a_way_straight_along_even_walls_and_nothing_else(parts):
    watched, scans = drive(parts, wobble=0.03, shaking=0.01)
    is_part = on(parts)
    assert watched.blocked[is_part].mean() > 0.7
    wider = np.convolve(is_part, np.ones(17), "same") > 0
    assert not watched.blocked[~wider].any()
    assert (watched.since[watched.blocked] == 0.0).all()
    # From the first scan on hardly anything of them is left, and all else is.
    there = seen(parts, SE2.identity())[is_part]
    for keep in (watched.cleared, watched.without):
        kept = np.array([keep(scan).ranges for scan in scans])
        assert (np.abs(kept[:, is_part] - there) < 0.05).mean() < 0.02
        assert not np.isnan(kept[:, ~wider]).any()


def test_they_are_found_after_a_metre():
    found = [drive(POSTS, length=length)[0].blocked.any() for length in (0.7, 1.5)]
    assert found == [False, True]


@pytest.mark.parametrize(
    ("before", "length", "found"),
    [(0.0, 1.5, True), (6.0, 1.5, False), (6.0, 2.1, True), (math.inf, 1.8, False), (math.inf, 2.7, True)],
)
def test_what_is_remembered_counts_from_where_it_begins(before, length, found):
    assert drive(POSTS, length=length, forget=(7, before))[0].blocked.any() == found


def test_what_is_known_is_not_forgotten():
    watched, scans = drive(POSTS, length=3.0, forget=(25, math.inf))
    assert watched.blocked[on(POSTS)].mean() > 0.7
    assert (watched.since[watched.blocked] == 0.0).all()
    assert np.isnan(watched.cleared(scans[0]).ranges[on(POSTS)]).mean() > 0.9


def test_what_became_constant_lately_is_so_since_then():
    """A wall comes beside the robot at the third look of four, of which the first is forgotten."""
    late = [(0.45, 0.6, 70.0, 0.6), (-10.0, 2.0, 0.45, 2.0), EVEN[0], EVEN[2], EVEN[3]]
    watched, _ = drive(walls=late, length=0.9, forget=(9, 1.0))
    beside = np.argmin(np.abs(ANGLES - 0.5 * math.pi))
    assert watched._state[2, beside] == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("y", [0.0, 0.4, 0.65])
@pytest.mark.parametrize("wobble", [0.0, 0.03])
def test_walls_followed_for_long_are_no_parts(y, wobble):
    watched, scans = drive(length=50.0, y=y, wobble=wobble)
    assert not watched.were_any()
    assert watched.without(scans[-1]) is scans[-1]
    assert watched.cleared(scans[0]) is scans[0]


def test_a_row_of_posts_as_far_apart_as_the_looks_is_no_part():
    fence = [side for k in range(60) for side in np.array(post(0.0, 0.0)) + np.tile((0.25 * k, 0.6), 2)]
    assert not drive(walls=[*EVEN, *fence], length=10.0)[0].were_any()


def test_a_standing_robot_tells_nothing():
    rng, watched = np.random.default_rng(1), PartsInView(PartsInViewConfig())
    ranges = np.minimum(seen(EVEN, SE2.identity()), seen(POSTS, SE2.identity()))
    for k in range(300):
        scan = LaserScan(float(k), FIRST, STEP, 0.02, 30.0, ranges + rng.normal(0.0, NOISE, BEAMS))
        watched.look(scan, SE2(0.0, 0.0, 0.002 * math.sin(k)), SE2(0.1 * k, 0.0, 0.0))
    assert not watched.were_any()


def test_wheels_that_spin_beside_a_box_make_no_part_of_it():
    """The scans say that the robot stands, and odometry alone does not count."""
    rng, watched = np.random.default_rng(1), PartsInView(PartsInViewConfig())
    ranges = np.minimum(seen(EVEN, SE2.identity()), seen(post(30.0, 0.8, 0.2), SE2.identity()))
    for k in range(100):
        scan = LaserScan(float(k), FIRST, STEP, 0.02, 30.0, ranges + rng.normal(0.0, NOISE, BEAMS))
        watched.look(scan, SE2(0.001 * k, 0.0, 0.0), SE2(0.1 * k, 0.0, 0.0))
    assert not watched.were_any()


def test_what_goes_along_for_a_while_is_left_out_for_that_while():
    watched, scans = drive(post(0.0, 0.9, 0.2), length=12.0, during=(30, 90))
    assert not watched.blocked.any()
    hidden = np.array([np.isnan(watched.cleared(scan).ranges).sum() for scan in scans])
    assert (hidden[35:88] > 20).all()
    assert hidden[:28].max() == 0 == hidden[96:].max()


def glass(wobble):
    """Drive along a wall of glass, of which a laser sees what is square to it."""
    rng, watched = np.random.default_rng(3), PartsInView(PartsInViewConfig())
    behind = [(-10.0, -0.9, 70.0, -0.9), (-10.0, 3.0, 70.0, 3.0), (70.0, -0.9, 70.0, 3.0), (-10.0, -0.9, -10.0, 3.0)]
    found = []
    for k in range(80):
        pose = SE2(0.1 * k, 0.0, wobble * math.sin(0.2 * k))
        square = np.abs(ANGLES + pose.theta - 0.5 * math.pi) < math.radians(12.0)
        ranges = np.where(square, seen(EVEN, pose), seen(behind, pose)) + rng.normal(0.0, NOISE, BEAMS)
        watched.look(LaserScan(float(k), FIRST, STEP, 0.02, 30.0, ranges), pose, pose)
        found.append(bool(watched.blocked.any()))
    return found


def test_a_wall_of_glass_that_does_not_turn_with_the_robot_is_no_part():
    assert not any(glass(wobble=0.03))


def test_what_might_be_glass_must_come_along_for_longer():
    found = glass(wobble=0.0)
    assert not any(found[:50])
    assert found[-1]


def test_odometry_that_says_otherwise_begins_it_anew():
    watched, rng = PartsInView(PartsInViewConfig()), np.random.default_rng(0)
    for k in range(60):
        pose = SE2(0.1 * k, 0.0, 0.0)
        ranges = np.minimum(seen(EVEN, pose), seen(POSTS, SE2.identity())) + rng.normal(0.0, NOISE, BEAMS)
        watched.look(LaserScan(float(k), FIRST, STEP, 0.02, 30.0, ranges), pose, SE2(0.01 * k, 0.0, 0.0))
    assert not watched.were_any()
    assert drive(POSTS, odometry=False)[0].blocked.any()


def test_another_number_of_beams_begins_anew_and_keeps_what_was():
    watched, scans = drive(POSTS)
    other = LaserScan(99.0, FIRST, 2.0 * STEP, 0.02, 30.0, np.full(180, 5.0))
    assert watched.without(other) is other
    watched.look(other, SE2(9.0, 0.0, 0.0), None)
    assert not watched.blocked.any()
    assert np.isnan(watched.cleared(scans[30]).ranges).any()
    assert watched.were_any()


def test_a_laser_that_turns_clockwise_finds_the_same():
    rng, watched = np.random.default_rng(0), PartsInView(PartsInViewConfig())
    for k in range(60):
        pose = SE2(0.1 * k, 0.0, 0.0)
        ranges = np.minimum(seen(EVEN, pose), seen(POSTS, SE2.identity())) + rng.normal(0.0, NOISE, BEAMS)
        watched.look(LaserScan(float(k), -FIRST, -STEP, 0.02, 30.0, ranges[::-1]), pose, pose)
    assert watched.blocked[on(POSTS)[::-1]].mean() > 0.8
