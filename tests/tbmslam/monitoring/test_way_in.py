import itertools
import math

import numpy as np
import pytest

from tbmslam.laser_scan import LaserScan
from tbmslam.monitoring.way_in import is_shut
from tbmslam.se2 import SE2

HERE = SE2.identity()
WAY = [SE2(-3.0 + 0.25 * k, 0.0, 0.0) for k in range(13)]


def wall_behind(x, begin, end):
    """What a laser at the origin sees of a wall across x, and of a room of 20 m around it."""
    angles = np.radians(np.arange(-180.0, 180.0))
    cosine, sine = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = np.minimum(10.0 / np.abs(cosine), 10.0 / np.abs(sine))
        met = x / cosine
    ranges = np.where((met > 0.0) & (begin <= met * sine) & (met * sine <= end), met, ranges)
    return LaserScan(0.0, float(angles[0]), math.radians(1.0), 0.1, 30.0, ranges)


@pytest.mark.parametrize(
    ("wall", "shut"),
    [
        ((-1.0, -2.0, 2.0), True),
        ((-1.0, 0.4, 3.0), False),  # beside the way
        ((-1.0, -0.25, 0.25), False),  # somebody
        ((-3.5, -3.0, 3.0), False),  # where the robot did not come from
        ((-0.3, -1.0, 1.0), False),  # where it may have turned
        ((1.0, -2.0, 2.0), False),  # ahead
    ],
)
def test_only_a_wall_on_the_way_shuts_it(wall, shut):
    assert is_shut(WAY, wall_behind(*wall), HERE, HERE, 4.0) == shut


def test_the_laser_may_be_anywhere_on_the_robot():
    turned = SE2(0.2, 0.1, 2.0)
    scan = wall_behind(-1.0, -2.0, 2.0)
    way = [turned @ pose for pose in WAY]
    assert is_shut(way, scan, turned, turned, 4.0)
    assert not is_shut(way, scan, HERE, HERE, 4.0)


def test_walls_out_of_reach_and_no_way_are_nothing():
    scan = wall_behind(-2.0, -3.0, 3.0)
    assert is_shut(WAY, scan, HERE, HERE, 4.0)
    assert not is_shut(WAY, scan, HERE, HERE, 1.5)
    assert not is_shut(WAY[-1:], scan, HERE, HERE, 4.0)
    assert not is_shut([], scan, HERE, HERE, 4.0)
    assert not is_shut(WAY, scan.with_ranges(np.full(360, np.inf)), HERE, HERE, 4.0)


@pytest.mark.parametrize(("beside", "shut"), [(-0.1, True), (0.13, False)])
def test_a_wall_along_which_the_robot_drove_does_not_shut_the_way(beside, shut):
    """A robot that cleans drives as near to walls, and sees them nearer still, now and then."""
    scan, along = wall_behind(-2.0, -1.0, 2.0), [SE2(-2.0 + beside, -1.0 + 0.25 * k, 0.0) for k in range(6)]
    over = [SE2(-2.0 + 0.3 * (-1.0) ** k, -1.0 + 0.25 * k, 0.0) for k in range(6)]
    assert is_shut(over if shut else along, scan, HERE, HERE, 4.0) == shut


def test_cleaning_along_walls_is_told_as_no_lift():
    """Three rounds at 0.18 m from the walls of a room of 3 m, then a stay in its middle."""
    corners = [(0.18, 0.18), (2.82, 0.18), (2.82, 2.82), (0.18, 2.82), (0.18, 0.18)]
    way = [
        SE2(*(np.array(a) + (np.array(b) - a) * k / 12), 0.0) for a, b in itertools.pairwise(corners) for k in range(12)
    ]
    middle, rng = SE2(1.5, 1.5, 0.0), np.random.default_rng(0)
    angles = np.radians(np.arange(-180.0, 180.0))
    exact = 1.5 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    for _ in range(20):
        scan = LaserScan(0.0, -math.pi, math.radians(1.0), 0.1, 30.0, exact - np.abs(rng.normal(0.0, 0.03, 360)))
        scan.ranges[200] -= 0.3  # a wrong beam
        assert not is_shut(way, scan, middle, middle, 4.0)
