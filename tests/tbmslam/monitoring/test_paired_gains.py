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
        sizes = [gains.add(gain) for gain in group]
        assert sizes == list(range(1, len(group) + 1))
        gains.end_group()
    means = np.array([np.mean(group) for group in groups])
    squares = float((means**2).sum())
    assert gains.groups == len(groups)
    assert gains.deviations() == pytest.approx(float(means.sum()) / math.sqrt(squares) if squares else 0.0, abs=1e-9)


def test_an_empty_group_does_not_count():
    gains = PairedGains()
    gains.end_group()
    assert (gains.groups, gains.deviations()) == (0, 0.0)


def test_chance_hardly_ever_exceeds_the_bound():
    rng = np.random.default_rng(0)
    signs = rng.choice([-1.0, 1.0], (20000, 60)) * rng.exponential(1.0, (20000, 60))
    sums = signs.sum(axis=1) / np.sqrt((signs**2).sum(axis=1))
    for z in (2.0, 3.0, 3.5):
        assert (sums > z).mean() <= math.exp(-0.5 * z * z)
