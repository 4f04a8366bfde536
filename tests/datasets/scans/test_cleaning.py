from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from datasets.scans.cleaning import (
    CODE_TOLERANCE,
    FARTHEST,
    FATES,
    KNOWN_CODES,
    RangeRules,
    clean_ranges,
    find_no_return_code,
)


@given(
    arrays(np.float32, st.integers(0, 50), elements=st.floats(width=32, allow_nan=True, allow_infinity=True)),
    st.sampled_from(["free", "drop"]),
)
def test_every_beam_has_one_fate_and_hits_lie_within_limits(ranges, no_return):
    before = ranges.copy()
    (cleaned,), (beams,) = clean_ranges(ranges[None], 0.1, 30.0, RangeRules(None, None, KNOWN_CODES, no_return))
    hits = cleaned[np.isfinite(cleaned)]
    assert ((hits >= 0.1) & (hits < 30.0)).all()
    assert beams.sum() == len(ranges)
    assert beams[FATES.index("hit")] == len(hits)
    assert not np.isneginf(cleaned).any()
    np.testing.assert_array_equal(ranges, before)


@given(
    arrays(
        np.float32,
        st.integers(0, 50),
        elements=st.one_of(
            st.floats(width=32, allow_nan=True, allow_infinity=True),
            st.sampled_from([np.float32(code) for code in (*KNOWN_CODES, 8.0, 8.0004, 8.0006, 30.0, 0.1, 0.0, -1.0)]),
        ),
    ),
    st.sampled_from([0.0, 0.1]),
    st.sampled_from([5.0, 30.0, 81.87, 100.0, np.inf]),
    st.sampled_from([(), (0.0,), (-1.0,)]),
)
def test_every_beam_has_the_fate_that_the_rules_say(ranges, range_min, range_max, more_codes):
    codes = (*KNOWN_CODES, 8.0, *more_codes)
    expected = Counter()
    (cleaned,), (beams,) = clean_ranges(ranges[None], range_min, range_max, RangeRules(None, None, codes, "free"))
    for beam, value in zip(ranges.tolist(), cleaned.tolist(), strict=True):
        if np.isnan(beam):
            fate, clean = "nan", np.nan
        elif beam >= range_max or beam == np.inf or any(abs(beam - code) < CODE_TOLERANCE for code in codes):
            fate, clean = "no_return", np.inf
        elif beam == 0.0:
            fate, clean = "zero", np.nan
        elif beam < range_min or beam < 0.0:
            fate, clean = "too_close", np.nan
        else:
            fate, clean = "hit", beam
        expected[fate] += 1
        np.testing.assert_equal(value, clean)
    assert beams.tolist() == [expected[fate] for fate in FATES]


@given(
    arrays(np.float32, (4, 9), elements=st.sampled_from([*map(np.float32, KNOWN_CODES), 0.0, -1.0, 0.05, 5.0, np.nan])),
    st.sampled_from(["free", "drop"]),
)
def test_many_scans_at_once_are_cleaned_as_each_alone(ranges, no_return):
    rules = RangeRules(None, None, KNOWN_CODES, no_return)
    together = clean_ranges(ranges, 0.1, 81.88, rules)
    alone = [clean_ranges(scan[None], 0.1, 81.88, rules) for scan in ranges]
    np.testing.assert_array_equal(together.ranges, np.concatenate([each.ranges for each in alone]))
    np.testing.assert_array_equal(together.beams, np.concatenate([each.beams for each in alone]))


def test_codes_count_wherever_they_lie():
    rules = RangeRules(None, None, (*KNOWN_CODES, 8.0), "free")
    ranges = np.array([81.83, 81.91, 65.53, 8.0, 50.0, 7.99], dtype=np.float32)
    (cleaned,), _ = clean_ranges(ranges[None], 0.0, 100.0, rules)
    assert np.isinf(cleaned).tolist() == [True, True, True, True, False, False]


def test_exactly_the_maximum_is_no_hit():
    rules = RangeRules(None, None, (), "free")
    limit = float(np.float32(5.6))
    assert np.isinf(clean_ranges(np.array([[5.6]], np.float32), 0.0, limit, rules).ranges).all()


@pytest.mark.parametrize(
    ("stated", "given_limits", "expected"),
    [
        ((0.1, 30.0), (None, None), (0.1, 30.0)),
        ((0.1, 30.0), (0.5, 10.0), (0.5, 10.0)),
        ((np.nan, np.nan), (None, None), (0.0, FARTHEST)),
        ((-1.0, 0.0), (None, None), (0.0, FARTHEST)),
        ((0.1, np.inf), (None, None), (0.1, FARTHEST)),
        ((0.1, 3e38), (None, None), (0.1, FARTHEST)),
        ((0.1, 3e38), (None, 5000.0), (0.1, 5000.0)),
        ((30.0, 0.1), (None, None), (0.0, FARTHEST)),
        ((0.1, 0.0), (None, None), (0.1, FARTHEST)),
    ],
)
def test_limits(stated, given_limits, expected):
    assert RangeRules(*given_limits, (), "free").limits(*stated) == expected


def test_ranges_with_an_offset():
    rules = RangeRules(None, None, (), "free", -0.1)
    ranges, low, high = rules.shifted(np.array([0.05, 0.5, np.inf, np.nan, 30.0]), 0.02, 30.0)
    np.testing.assert_allclose(ranges, [np.nan, 0.4, np.inf, np.nan, 29.9])
    assert (low, high) == (0.0, 29.9)
    stays = np.array([0.05, np.inf])
    assert RangeRules(None, None, (), "free").shifted(stays, 0.02, 30.0) == (stays, 0.02, 30.0)


def walls(number=60, beams=180, far=25.0):
    rng = np.random.default_rng(1)
    return [np.round(rng.uniform(1.0, far, beams), 2) for _ in range(number)]


def test_a_code_below_the_maximum_is_found():
    scans = walls()
    for scan in scans:
        scan[::30] = 50.0
    assert find_no_return_code(scans) == 50.0
    assert find_no_return_code(scans, known=[50.0]) is None


def test_walls_are_no_code():
    assert find_no_return_code(walls()) is None
    assert find_no_return_code([np.full(180, 4.0)] * 3) is None
    standing = np.round(np.linspace(1.0, 12.34, 180), 2)
    assert find_no_return_code([standing] * 200) is None
    assert find_no_return_code([]) is None
    assert find_no_return_code([np.array([np.nan, 0.0])]) is None
