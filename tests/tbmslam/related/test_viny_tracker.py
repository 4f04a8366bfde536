"""The Monte Carlo matcher's schedule, without the original's recorded runs."""

import numpy as np
import pytest

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.related.viny_tracker import MonteCarloConfig, MonteCarloMatcher
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors

SCAN = LaserScan(0.0, 0.0, 0.1, 0.1, 30.0, np.array([2.03]))
"""One hit straight ahead."""


def slope():
    """A grid in which a hit is worth more the farther ahead it is."""
    grid = EvidenceGrid(0.1)
    grid.grow_to_contain(np.array([[0.0, -0.5], [5.0, 0.5]]))
    hit = np.asarray(beam_factors(SensorModelConfig(), 0.1, 0.9).hit)
    for x in np.arange(0.05, 5.0, 0.1):
        row, col = grid.geometry.cell_at(x, 0.0)
        grid.ratios[row, col] *= hit ** (0.05 * x)
    return grid


@pytest.mark.parametrize(
    ("failures", "moves"),
    [
        ([0, 0, 0], [0.2, 0.2, 0.2]),  # easy successes: the search stays wide
        ([6, 0], [0.2, 0.2]),  # six of twenty failures are no third of them
        ([7, 0], [0.2, 0.1]),
        ([4, 3, 0], [0.2, 0.2, 0.1]),  # failures add up over successes
        ([7, 3, 3, 0], [0.2, 0.1, 0.1, 0.1]),  # and begin again at each halving
    ],
)
def test_the_deviation_is_halved_only_by_a_success_that_took_long(failures, moves):
    """Before each success so many candidates stay where the search is; a success goes ahead by one deviation."""
    left = list(failures)

    def draw(count):
        normals = np.zeros((count, 3))
        if left:
            normals[left.pop(0), 0] = 1.0
        return normals

    found = MonteCarloMatcher(MonteCarloConfig(), draw).match(SCAN, slope(), SE2.identity())
    assert found.T_map_sensor == pytest.approx((sum(moves), 0.0, 0.0))
