"""The surfels of the last metres of a drive."""

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import Hits
from tbmslam.tracking.local_surfels import LocalSurfels
from tbmslam.tracking.surfel_map import SurfelConfig

WALL = Hits(np.column_stack((np.linspace(-0.4, 0.4, 81), np.full(81, 1.0))), np.tile([0.0, -1.0], (81, 1)))
NO_OUTLINE = np.empty((0, 5)), 0.0, 1.0, (0.0, 0.0, 0.0)


def known_at(surfels, x):
    """Return the share of a wall at a place that is known."""
    known, strays = surfels.map.known_hits(WALL, SE2(x, 0.0, 0.0), 0.1, 4.0, NO_OUTLINE)
    return known / (known + strays)


@pytest.mark.parametrize("window", [2.5, 6.0])
def test_the_surfels_reach_back_one_to_two_windows(window):
    """A robot drives by a wall of pieces, one each metre."""
    surfels = LocalSurfels(SurfelConfig(), window)
    for x in np.arange(21.0):
        surfels.insert(WALL, SE2(x, 0.0, 0.0))
        passed = np.arange(x + 1.0)
        known = np.array([known_at(surfels, place) > 0.8 for place in passed])
        assert known[passed >= x - window].all()
        assert not known[passed < x - 2.0 * window - 1.0].any()
    assert not known.all()


def test_a_robot_that_turns_on_the_spot_forgets_nothing():
    surfels = LocalSurfels(SurfelConfig(), 0.5)
    surfels.insert(WALL, SE2.identity())
    for turn in np.linspace(0.0, 6.0, 40):
        surfels.insert(WALL, SE2(0.0, 0.0, turn))
    assert known_at(surfels, 0.0) > 0.7  # the corners of the turned walls blur its surfels
