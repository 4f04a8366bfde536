"""What is square to the way, and whether it turns with the robot."""

import math

import numpy as np
import pytest

from tbmslam.monitoring.glass_walls import is_square_to_way, turns_along

STEP = 0.0131
LASERS = np.array([(0.25 * k, 0.0, 0.03 * math.sin(1.3 * k)) for k in range(8)])


@pytest.mark.parametrize(("bearing_deg", "square"), [(90.0, True), (-83.0, True), (60.0, False), (0.0, False)])
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_square_is_square_to_the_way_and_not_to_the_robot(bearing_deg, square, heading):
    turned = LASERS + np.array((0.0, 0.0, heading))
    bearing = np.array([math.radians(bearing_deg) - turned[-1, 2]])
    assert is_square_to_way(bearing, turned) is square


def spot(lasers, turning):
    """Return ranges in which something of twenty degrees is near, which turns with the robot or does not."""
    seen = np.full((len(lasers), 300), 5.0)
    for row, laser in zip(seen, lasers, strict=True):
        middle = 150 + (0 if turning else round(-laser[2] / STEP))
        row[middle - 13 : middle + 13] = 0.5
    return seen


def test_what_turns_with_the_robot_and_what_does_not():
    for turning, told in ((True, 1), (False, -1)):
        assert turns_along(137, 163, LASERS, spot(LASERS, turning), 0.6, STEP) == told


def test_nothing_tells_straight_ahead_nor_after_two_looks():
    straight = LASERS * (1.0, 1.0, 0.0)
    assert turns_along(137, 163, straight, spot(straight, turning=False), 0.6, STEP) == 0
    assert turns_along(137, 163, LASERS[:2], spot(LASERS[:2], turning=False), 0.6, STEP) == 0
