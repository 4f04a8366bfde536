import math

import numpy as np
import pytest
from scipy import stats

from tools.paper.published import (
    TABLE_1,
    TABLE_2,
    TABLE_3,
    TABLE_4,
    half_interval,
    indistinguishable_from_best,
    paired_p_value,
)


def test_table_1_line_by_line():
    """As the paper prints it: ORB, BRISK, SIFT, SURF, and the best of each line."""
    assert list(TABLE_1) == ["ORB", "BRISK", "SIFT", "SURF"]
    assert list(zip(*TABLE_1.values(), strict=True)) == [
        (0.958, 0.889, 0.25, 0.0),
        (1.0, 1.0, 1.0, 0.951),
        (0.714, 0.5, 0.0, 0.0),
        (0.993, 1.0, 1.0, 1.0),
        (0.96, 0.818, 0.0, 0.0),
        (0.999, 1.0, 1.0, 1.0),
        (0.999, 0.998, 1.0, 0.996),
    ]


def test_the_sums_of_tables_2_to_4():
    """Counted from the paper's text: a column's sum changes with any of its values."""
    rows = [row.values for row in TABLE_2.values()]
    sums = [tuple(np.sum([row[letter] for row in rows], axis=0)) for letter in "abcde"]
    expected = [(13.11, 1.44), (14.47, 0.84), (7.04, 0.80), (7.78, 1.00), (8.43, 1.36)]
    np.testing.assert_allclose(sums, expected, atol=1e-6)
    assert np.sum(TABLE_3, axis=0) == pytest.approx([0.138, 149.014, 1.510])
    assert np.sum(TABLE_4, axis=0) == pytest.approx([84925.0, 9762.7, 817.921])


def test_a_row_of_table_2():
    row = TABLE_2[1000, 0.7]
    assert row.values["b"] == (0.83, 0.03)
    assert row.values["e"] == (0.22, 0.05)
    assert row.best == "b"


def test_every_row_is_whole():
    for row in TABLE_2.values():
        assert list(row.values) == list("abcde")
        assert set(row.best) <= set("abcde")
    assert len(TABLE_2) == 20


def test_every_sign_of_every_difference_counts():
    first, second = np.array([0.5, 0.7, 0.6]), np.array([0.4, 0.4, 0.8])  # 0.1 + 0.3 - 0.2: 2 of 8 sums are smaller
    assert paired_p_value(first, second) == pytest.approx(0.75)
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
