import numpy as np
import pytest
from scipy.spatial.distance import cdist

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.search.place_matches import common_weight

TOLERANCE, NEAREST = 1.0, 3.0


def plain_twin(places, others, matched, weights):
    """Return the same by whole matrices."""
    here, there = cdist(places, places), cdist(others[matched], others[matched])
    agree = (here > NEAREST) & (there > 0.5 * NEAREST) & (np.abs(here - there) < TOLERANCE)
    agreeing = np.where(agree, np.sqrt(np.outer(weights, weights)), 0.0)
    vector = weights
    for _ in range(6):
        turned = agreeing @ vector
        length = np.linalg.norm(turned)
        if length == 0.0:
            return 0.0
        vector = turned / length
    return length


@pytest.mark.parametrize("count", [1, 5, 40])
def test_common_weight_is_that_of_its_plain_twin(generator, count):
    places, others = generator.uniform(0.0, 20.0, (count, 2)), generator.uniform(0.0, 20.0, (30, 2))
    matched, weights = generator.integers(0, 30, count), generator.uniform(0.0, 3.0, count)
    found = common_weight(places, others, matched, weights, TOLERANCE, NEAREST)
    assert found == pytest.approx(plain_twin(places, others, matched, weights), rel=1e-9)


def test_matches_that_keep_the_distances_weigh_more(generator):
    places, pose = generator.uniform(0.0, 40.0, (30, 2)), SE2(5.0, -3.0, 2.0)
    right, weights = np.arange(30), np.ones(30)
    wrong = generator.permutation(30)
    half = np.where(np.arange(30) < 15, right, wrong)
    found = [common_weight(places, pose.apply(places), m, weights, TOLERANCE, NEAREST) for m in (right, half, wrong)]
    assert found[0] > 25.0
    assert found[0] > 1.5 * found[1] > 2.0 * found[2]
