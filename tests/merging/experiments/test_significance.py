import math

import numpy as np
import pytest
from scipy import stats

from merging.experiments.published import half_interval, indistinguishable_from_best, paired_p_value


def test_the_permutation_test_is_scipy_s():
    generator = np.random.default_rng(1)
    first, second = generator.normal(0.3, 1.0, 8), generator.normal(0.0, 1.0, 8)
    expected = stats.permutation_test((first - second,), np.sum, permutation_type="samples", n_resamples=np.inf)
    assert paired_p_value(first, second) == pytest.approx(expected.pvalue)
    assert paired_p_value(second, first) == paired_p_value(first, second)


def test_pairs_without_a_value_are_left_out():
    first = np.array([1.0, 2.0, math.nan, 3.0])
    assert paired_p_value(first, np.array([0.5, 1.0, 1.0, 2.0])) == pytest.approx(0.25)
    assert paired_p_value(first, first) == 1.0


def test_too_many_pairs():
    with pytest.raises(ValueError, match=r"pairs must be 16 at most, got 17"):
        paired_p_value(np.arange(17.0), np.zeros(17))


def test_the_best_and_what_it_does_not_beat():
    noise = np.linspace(-0.01, 0.01, 10)
    values = {"a": 0.8 + noise, "b": 0.8 + noise[::-1], "c": 0.5 + noise, "d": np.full(10, math.nan)}
    assert indistinguishable_from_best(values) == ["a", "b"]
    assert indistinguishable_from_best({"d": values["d"]}) == []


def test_comparisons_are_corrected_for_their_number():
    """Six pairs, all better by as much: p = 2 / 64, significant as one of one comparison and not of two."""
    best, other = np.full(6, 0.8), np.full(6, 0.7)
    assert paired_p_value(best, other) == pytest.approx(0.03125)
    assert indistinguishable_from_best({"a": best, "b": other}) == ["a"]
    assert indistinguishable_from_best({"a": best, "b": other, "c": other}) == ["a", "b", "c"]


def test_after_a_rejection_the_next_is_corrected_by_fewer():
    """Holm, not Bonferroni: p = 2 / 128 passes 0.05 / 2, and then 0.03125 passes 0.05."""
    best = np.full(7, 0.8)
    nearer = np.array([0.7, 0.7, 0.7, 0.7, 0.7, 0.7, 0.8])
    assert paired_p_value(best, nearer) == pytest.approx(0.03125)
    assert indistinguishable_from_best({"a": best, "b": np.full(7, 0.7), "c": nearer}) == ["a"]


def test_the_interval_is_student_s():
    values = np.array([0.2, 0.4, 0.5, 0.9, math.nan])
    expected = stats.ttest_1samp(values[:4], 0.0).confidence_interval(0.95)
    assert half_interval(values) == pytest.approx((expected.high - expected.low) / 2)
    assert math.isnan(half_interval(values[:1]))
