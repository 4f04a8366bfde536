import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.monitoring.paired_gains import PairedGains


@given(st.lists(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=4), max_size=9))
def test_the_groups_count_by_their_means(groups):
    gains = PairedGains()
    for group in groups:
        for gain in group:
            gains.add(gain, 1.0 / len(group))
    means = np.array([np.mean(group) for group in groups])
    squares = float((means**2).sum())
    assert gains.groups == len(groups)
    assert gains.deviations() == pytest.approx(float(means.sum()) / math.sqrt(squares) if squares else 0.0, abs=1e-9)


def test_a_gain_without_share_and_an_incomplete_group_do_not_count():
    gains = PairedGains()
    gains.add(1.0, 0.5)
    gains.add(9.0, 0.0)
    assert (gains.groups, gains.deviations()) == (0, 0.0)
    gains.add(3.0, 0.5)
    assert (gains.groups, gains.deviations()) == (1, 1.0)


def test_chance_hardly_ever_exceeds_the_bound():
    rng = np.random.default_rng(0)
    signs = rng.choice([-1.0, 1.0], (20000, 60)) * rng.exponential(1.0, (20000, 60))
    sums = signs.sum(axis=1) / np.sqrt((signs**2).sum(axis=1))
    for z in (2.0, 3.0, 3.5):
        assert (sums > z).mean() <= math.exp(-0.5 * z * z)
