import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from tbmslam.tracking.fit_by_chance import _BY_CHANCE, misfit_cost

counts = st.integers(0, 200)


@given(counts, counts)
def test_the_cost_is_the_likelihood_ratio_of_two_binomial_distributions(known, strays):
    """Where the scan fits better than by chance; the most likely share counts."""
    hits = known + strays
    share = max(known / hits, _BY_CHANCE) if hits else _BY_CHANCE
    ratio = binom.logpmf(known, hits, share) - binom.logpmf(known, hits, _BY_CHANCE)
    assert misfit_cost(known, strays) == pytest.approx(-ratio, abs=1e-6)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.1, 200.0))
def test_no_scan_fits_better_with_more_strays(share, other, hits):
    worse, better = sorted((share, other))
    assert misfit_cost(better * hits, (1.0 - better) * hits) <= misfit_cost(worse * hits, (1.0 - worse) * hits) + 1e-9
    assert misfit_cost(worse * hits, (1.0 - worse) * hits) <= 1e-9


@pytest.mark.parametrize(("share", "log_odds"), [(0.98, 7.1), (0.8, 4.6), (0.5, 3.2), (0.2, 1.8)])
def test_a_stray_counts_less_in_a_new_place(share, log_odds):
    """Its log-odds are those of the share, less those of a fit by chance."""
    known, strays, step = 100.0 * share, 100.0 * (1.0 - share), 1e-4
    more = misfit_cost(known - step, strays + step) - misfit_cost(known, strays)
    assert more / step == pytest.approx(log_odds, abs=0.05)
    assert log_odds == pytest.approx(math.log(share / (1.0 - share) * (1.0 - _BY_CHANCE) / _BY_CHANCE), abs=0.05)
