"""Maps fused by any rule: in any order, with sources that say nothing, the result is the same belief."""

import itertools
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merging.config import Rule
from merging.fusion import fuse
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN, VACUOUS, pignistic
from tests.belief_rules import conjunctive, dempster, normalise

RULES = get_args(Rule)
ROUNDING = 2e-5  # single precision, some factors of which are divided by small sums


@st.composite
def layers(draw, most=4):
    """Draw maps of different sizes on one lattice, with cells that some or all of them never saw."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    made = []
    for _ in range(draw(st.integers(2, most))):
        rows, cols = rng.integers(2, 7, size=2)
        masses = rng.dirichlet((0.3, 1.0, 1.0, 1.0), size=(rows, cols))
        masses[rng.random((rows, cols)) < 0.3] = VACUOUS
        masses[rng.random((rows, cols)) < 0.1] = np.eye(4)[rng.choice((FREE, OCCUPIED))]
        row, col = rng.integers(-3, 4, size=2)
        made.append(TbmGrid(GridGeometry(0.1, 0.1 * col, 0.1 * row, rows, cols), masses.astype(np.float32)))
    return made


@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=15, deadline=None)
@given(maps=layers(), coverage=st.sampled_from(["union", "overlap"]))
def test_every_rule_gives_beliefs(rule, maps, coverage):
    fusion = fuse(maps, rule, coverage)
    assert (fusion.grid.masses >= 0.0).all()
    np.testing.assert_allclose(fusion.grid.masses.sum(axis=-1), 1.0, atol=1e-5)
    assert ((fusion.conflict >= 0.0) & (fusion.conflict <= 1.0 + 1e-6)).all()


@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=15, deadline=None)
@given(maps=layers(), trusts=st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4))
def test_the_order_matters_to_no_rule(rule, maps, trusts):
    expected = fuse(maps, rule, reliabilities=trusts[: len(maps)])
    for order in itertools.permutations(range(len(maps))):
        fusion = fuse([maps[k] for k in order], rule, reliabilities=[trusts[k] for k in order])
        assert tuple(fusion.grid.geometry) == pytest.approx(tuple(expected.grid.geometry))
        np.testing.assert_allclose(fusion.grid.masses, expected.grid.masses, atol=ROUNDING)
        np.testing.assert_allclose(fusion.conflict, expected.conflict, atol=ROUNDING)
        np.testing.assert_array_equal(fusion.seen_by, expected.seen_by)


@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=10, deadline=None)
@given(maps=layers())
def test_one_order_gives_the_same_bytes(rule, maps):
    assert fuse(maps, rule).grid.masses.tobytes() == fuse(maps, rule).grid.masses.tobytes()


@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=15, deadline=None)
@given(maps=layers(most=3), place=st.integers(0, 3))
def test_a_vacuous_source_changes_nothing(rule, maps, place):
    expected = fuse(maps, rule)
    vacuous = TbmGrid.unknown(expected.grid.geometry)
    fusion = fuse([*maps[:place], vacuous, *maps[place:]], rule)
    assert fusion.grid.masses.tobytes() == expected.grid.masses.tobytes()
    assert fusion.conflict.tobytes() == expected.conflict.tobytes()
    np.testing.assert_array_equal(fusion.seen_by, expected.seen_by)


def with_a_liar(maps, rule, place):
    """Fuse maps without and with one of occupied cells all over that nobody believes."""
    expected = fuse(maps, rule)
    liar = np.zeros_like(expected.grid.masses)
    liar[..., OCCUPIED] = 1.0
    trusts = [1.0] * len(maps)
    everybody = [*maps[:place], TbmGrid(expected.grid.geometry, liar), *maps[place:]]
    return expected, fuse(everybody, rule, reliabilities=[*trusts[:place], 0.0, *trusts[place:]])


def without_conflict(maps):
    return [TbmGrid(layer.geometry, normalise(layer.masses).astype(np.float32)) for layer in maps]


@pytest.mark.parametrize("rule", [rule for rule in RULES if rule != "dubois-prade"])
@settings(max_examples=15, deadline=None)
@given(maps=layers(most=3), place=st.integers(0, 3))
def test_a_source_that_is_not_believed_takes_no_side(rule, maps, place):
    """It was there, so that the disjunctive rule doubts what the others say; but it makes nothing more certain."""
    expected, fusion = with_a_liar(maps, rule, place)
    before, after = pignistic(expected.grid.masses) - 0.5, pignistic(fusion.grid.masses) - 0.5
    certain = expected.grid.masses[..., 0] < 0.99
    assert (before * after >= -ROUNDING)[certain].all()
    assert (np.abs(after) <= np.abs(before) + 1e-4)[certain].all()


@pytest.mark.parametrize("rule", ["conjunctive", "dempster", "dubois-prade", "yager", "unanimous"])
@settings(max_examples=15, deadline=None)
@given(maps=layers(most=3), place=st.integers(0, 3))
def test_a_source_that_is_not_believed_changes_nothing(rule, maps, place):
    """So it is for sources without a conflict of their own, whose unions with ignorance are ignorance anyhow."""
    expected, fusion = with_a_liar(without_conflict(maps), rule, place)
    np.testing.assert_allclose(fusion.grid.masses, expected.grid.masses, atol=ROUNDING)


@settings(max_examples=30, deadline=None)
@given(maps=layers(most=3), place=st.integers(0, 3))
def test_under_dubois_and_prade_a_source_of_reliability_zero_only_turns_conflict_into_ignorance(maps, place):
    """A set that is empty in common goes to the union, and the union with what says nothing is ignorance."""
    expected, fusion = with_a_liar(maps, "dubois-prade", place)
    before, after = expected.grid.masses, fusion.grid.masses
    assert (after[..., [FREE, OCCUPIED]] <= before[..., [FREE, OCCUPIED]] + ROUNDING).all()
    assert (after[..., CONFLICT] <= ROUNDING).all()
    least = fuse(maps, "conjunctive").grid.masses
    np.testing.assert_allclose(after[..., FREE], least[..., FREE], atol=ROUNDING)
    np.testing.assert_allclose(after[..., OCCUPIED], least[..., OCCUPIED], atol=ROUNDING)


@pytest.mark.parametrize("rule", ["log-odds", "entropy-filter"])
@settings(max_examples=15, deadline=None)
@given(maps=layers(most=3), place=st.integers(0, 3))
def test_who_is_not_believed_leaves_the_rules_of_probability_theirs(rule, maps, place):
    expected, fusion = with_a_liar(maps, rule, place)
    before, after = pignistic(expected.grid.masses), pignistic(fusion.grid.masses)
    alone = np.where(expected.seen_by == 1, np.clip(before, 0.001, 0.999), before)  # the most that one's log odds say
    sure = expected.grid.masses[..., CONFLICT] < 0.99
    np.testing.assert_allclose(after[sure], alone[sure], atol=1e-4)


@settings(deadline=None)
@given(maps=layers(most=3))
def test_conflict_is_that_of_the_conjunction(maps):
    fusion = fuse(maps, "conjunctive")
    both = fuse(without_conflict(maps), "conjunctive").grid.masses[..., 0]
    several = fusion.seen_by > 1
    np.testing.assert_allclose(fusion.conflict[several], both[several], atol=1e-4)


shares = st.floats(0.01, 1.0)
beliefs = st.tuples(st.floats(0.0, 0.9), shares, shares, shares).map(lambda w: np.array(w) / sum(w))


@given(beliefs, beliefs, beliefs)
def test_dempster_s_rule_is_associative_and_normalising_may_wait(first, second, third):
    at_once = normalise(conjunctive(conjunctive(first, second), third))
    np.testing.assert_allclose(dempster(dempster(first, second), third), at_once, atol=1e-9)
    np.testing.assert_allclose(dempster(first, dempster(second, third)), at_once, atol=1e-9)


@given(beliefs)
def test_a_vacuous_source_is_neutral_under_dempster_s_rule(belief):
    np.testing.assert_allclose(dempster(belief, VACUOUS), normalise(belief), atol=1e-12)
    assert dempster(VACUOUS, VACUOUS)[UNKNOWN] == 1.0
