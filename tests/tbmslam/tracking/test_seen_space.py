import math

import numpy as np
import pytest

from tbmslam.laser_scan import Hits
from tbmslam.se2 import SE2
from tbmslam.tracking.seen_space import SeenSpace, may_walk, small_things


def wall(*things):
    """Return hits on a round wall of 5 m radius, and on things at (angle, distance) that hide a part of it."""
    angles = np.radians(np.arange(-180.0, 180.0, 0.5))
    distances = np.full(len(angles), 5.0)
    for angle, distance in things:
        distances[np.abs(angles - angle) < 0.1] = distance
    towards = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    return Hits(distances[:, None] * towards, -towards)


def distances_of(hits):
    return np.hypot(*hits.points.T)


def test_walls_stay_and_what_walks_in_does_not():
    space = SeenSpace(3, 0.2)
    assert len(space.still(wall(), SE2.identity()).points) == 720
    seen = space.still(wall((1.0, 2.0)), SE2.identity())
    assert distances_of(seen).min() == pytest.approx(5.0)
    assert len(seen.points) == len(seen.normals) == 720 - 23


def test_what_stood_there_from_the_beginning_stays_also_seen_from_elsewhere():
    space = SeenSpace(3, 0.2)
    first = wall((1.0, 2.0))
    assert space.still(first, SE2.identity()) is first
    moved = SE2(0.3, -0.2, 0.7)
    again = Hits(*(first.placed(moved.inverse()).points, first.normals))
    assert len(space.still(again, moved).points) == 720


def test_nothing_is_known_of_where_no_beam_came_back_and_of_long_ago():
    space = SeenSpace(2, 0.2)
    half = wall()
    space.still(Hits(half.points[:360], half.normals[:360]), SE2.identity())  # only the lower half
    assert len(space.still(wall((1.0, 2.0)), SE2.identity()).points) == 720
    space = SeenSpace(1, 0.2)
    for hits in (wall(), wall((1.0, 2.0))):
        space.still(hits, SE2.identity())
    assert len(space.still(wall((1.0, 2.0)), SE2.identity()).points) == 720


def test_small_differences_are_noise():
    space = SeenSpace(2, 0.2)
    space.still(wall(), SE2.identity())
    assert len(space.still(wall((1.0, 4.81)), SE2.identity()).points) == 720
    assert len(space.still(wall((1.0, 4.79)), SE2.identity()).points) < 720


def test_an_empty_scan_is_one():
    space = SeenSpace(2, 0.2)
    nothing = Hits(np.zeros((0, 2)), np.zeros((0, 2)))
    for hits in (nothing, wall(), nothing):
        assert len(space.still(hits, SE2(1.0, 2.0, math.pi)).points) == len(hits.points)


def test_asking_does_not_remember():
    space = SeenSpace(3, 0.2)
    space.still(wall((1.0, 2.0)), SE2.identity())
    for _ in range(5):  # would else be forgotten
        assert len(space.standing(wall(), SE2.identity()).points) == 720
    assert distances_of(space.standing(wall((-1.0, 2.0)), SE2.identity())).min() == pytest.approx(5.0)


def test_people_may_walk_and_walls_do_not():
    legs = np.array([[1.0, 0.0], [1.0, 0.1], [1.1, 0.3], [2.0, 2.0], [2.1, 2.0]])
    wall_ahead = np.stack((np.full(20, 3.0), np.linspace(-1.0, 1.0, 20)), axis=1)
    assert may_walk(legs)
    assert may_walk(legs[:1])
    assert not may_walk(wall_ahead)
    assert not may_walk(np.vstack((legs, wall_ahead)))
    assert not may_walk(np.zeros((0, 2)))


def test_it_is_told_which_hits_stand_where_nothing_was():
    space = SeenSpace(3, 0.2)
    assert not space.in_seen_space(wall(), SE2.identity()).any()
    space.still(wall(), SE2.identity())
    hits = wall((1.0, 2.0))
    np.testing.assert_array_equal(
        hits.points[~space.in_seen_space(hits, SE2.identity())], space.standing(hits, SE2.identity()).points
    )


def test_things_are_small_and_stand_before_what_is_beside_them():
    angles = np.linspace(-1.0, 1.0, 101)
    ranges = 3.0 / np.cos(angles)
    ranges[20:30] = 1.0  # a person
    ranges[50:90] = 2.0  # a wall of 1.6 m
    ranges[95:] = 2.5  # a person at the edge of the view
    ranges[40:44] = 8.0  # an open door
    points = ranges[:, None] * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    assert np.flatnonzero(small_things(points)).tolist() == [*range(20, 30), *range(95, 101)]
    assert len(small_things(np.zeros((0, 2)))) == 0
