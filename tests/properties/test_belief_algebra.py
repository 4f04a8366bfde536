"""The belief algebra: every rule gives beliefs, and obeys the laws its source states."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN, VACUOUS, pignistic
from tests.belief_rules import conjunctive, dempster, discount, disjunctive, normalise

FULL_CONFLICT = np.array([1.0, 0.0, 0.0, 0.0])
shares = st.floats(0.0, 1.0, allow_subnormal=False)


@st.composite
def beliefs(draw):
    """Four masses; hypothesis likes zeros, which is where the rules have their corners."""
    weights = np.array([draw(shares) for _ in range(4)])
    return weights / weights.sum() if weights.sum() > 1e-6 else VACUOUS.copy()


def assert_same(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-12)


def assert_belief(masses):
    assert (masses >= 0.0).all()
    assert_same(masses.sum(axis=-1), 1.0)


def by_subsets(first, second, combine):
    """Eq. 5 and 6 as they are written: a double sum over subsets, here as bit patterns."""
    combined = np.zeros(4)
    for a in range(4):
        for b in range(4):
            combined[combine(a, b)] += first[a] * second[b]
    return combined


@given(beliefs(), beliefs())
def test_rules_are_the_sums_over_subsets(first, second):
    assert_same(conjunctive(first, second), by_subsets(first, second, lambda a, b: a & b))
    assert_same(disjunctive(first, second), by_subsets(first, second, lambda a, b: a | b))


@given(beliefs(), beliefs(), st.floats(0.0, 1.0))
def test_every_rule_gives_a_belief(first, second, reliability):
    for result in (
        conjunctive(first, second),
        disjunctive(first, second),
        dempster(first, second),
        normalise(first),
        discount(first, reliability),
    ):
        assert_belief(result)


@given(beliefs(), beliefs())
def test_rules_are_commutative(first, second):
    for rule in (conjunctive, disjunctive, dempster):
        assert_same(rule(first, second), rule(second, first))


@given(beliefs(), beliefs(), beliefs())
def test_rules_are_associative(first, second, third):
    for rule in (conjunctive, disjunctive):
        assert_same(rule(rule(first, second), third), rule(first, rule(second, third)))


@given(beliefs())
def test_neutral_and_absorbing_elements(belief):
    assert_same(conjunctive(belief, VACUOUS), belief)
    assert_same(disjunctive(belief, FULL_CONFLICT), belief)
    assert_same(conjunctive(belief, FULL_CONFLICT), FULL_CONFLICT)
    assert_same(disjunctive(belief, VACUOUS), VACUOUS)


@given(beliefs(), beliefs())
def test_the_rules_are_dual(first, second):
    """De Morgan: the complement of a subset is its bits inverted, which reverses the four masses (Smets 1993)."""
    assert_same(conjunctive(first, second)[::-1], disjunctive(first[::-1], second[::-1]))


@given(beliefs(), beliefs())
def test_conjunction_loses_no_certainty_and_disjunction_gains_none(first, second):
    assert conjunctive(first, second)[UNKNOWN] <= min(first[UNKNOWN], second[UNKNOWN]) + 1e-12
    assert disjunctive(first, second)[CONFLICT] <= min(first[CONFLICT], second[CONFLICT]) + 1e-12


@given(beliefs())
def test_normalising_leaves_no_conflict_and_does_nothing_twice(belief):
    once = normalise(belief)
    assert once[CONFLICT] == 0.0
    assert_same(normalise(once), once)


@given(beliefs())
def test_normalising_keeps_proportions(belief):
    if belief[CONFLICT] < 0.999:
        assert_same(normalise(belief)[1:] * (1.0 - belief[CONFLICT]), belief[1:])


@given(beliefs(), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_discounting_twice_is_discounting_by_the_product(belief, first, second):
    assert_same(discount(discount(belief, first), second), discount(belief, first * second))


@given(beliefs())
def test_discounting_keeps_a_reliable_source_and_makes_an_unreliable_source_vacuous(belief):
    assert_same(discount(belief, 1.0), belief)
    assert_same(discount(belief, 0.0), VACUOUS)


@given(beliefs(), st.floats(0.0, 1.0))
def test_discounting_draws_the_bet_towards_one_half_without_crossing_it(belief, reliability):
    before, after = pignistic(belief) - 0.5, pignistic(discount(belief, reliability)) - 0.5
    assert before * after >= -1e-12
    assert abs(after) <= abs(before) + 1e-9


@given(beliefs())
def test_the_bet_is_a_probability_and_symmetric(belief):
    bet = pignistic(belief)
    assert 0.0 <= bet <= 1.0 + 1e-15
    mirrored = belief[[CONFLICT, OCCUPIED, FREE, UNKNOWN]]
    if belief[CONFLICT] < 0.999:
        assert_same(bet + pignistic(mirrored), 1.0)


@given(beliefs())
def test_the_bet_does_not_see_conflict(belief):
    if belief[CONFLICT] < 0.999:
        assert_same(pignistic(normalise(belief)), pignistic(belief))
