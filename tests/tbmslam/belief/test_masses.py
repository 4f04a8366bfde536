"""The belief algebra on values known from elsewhere, and its refusals; its laws are in tests/properties."""

import numpy as np
import pytest

from tbmslam.belief.masses import CONFLICT, OCCUPIED, UNKNOWN, VACUOUS, pignistic
from tests.belief_rules import conjunctive, dempster, discount, disjunctive, normalise

SURELY_FREE = np.array([0.0, 1.0, 0.0, 0.0])
SURELY_OCCUPIED = np.array([0.0, 0.0, 1.0, 0.0])
FULL_CONFLICT = np.array([1.0, 0.0, 0.0, 0.0])


def test_contradiction_is_conflict_or_ignorance():
    np.testing.assert_array_equal(conjunctive(SURELY_FREE, SURELY_OCCUPIED), FULL_CONFLICT)
    np.testing.assert_array_equal(disjunctive(SURELY_FREE, SURELY_OCCUPIED), VACUOUS)


def test_dempster_on_zadeh_s_kind_of_example():
    """0.6 for occupied against 0.5 for free: 0.3 conflicts, the rest is shared out over 0.7."""
    combined = dempster([0, 0, 0.6, 0.4], [0, 0.5, 0, 0.5])
    np.testing.assert_allclose(combined, [0, 2 / 7, 3 / 7, 2 / 7])


def test_a_hundred_hits_as_the_original_program_counts_them():
    """design: hit p = 0.95, k = 0.04, scan quality 0.9, printed by vinySLAM itself."""
    weight = 0.04 * 0.9
    hit = [0.0, 0.05 * weight, 0.95 * weight, 1 - weight]
    cell = VACUOUS
    for _ in range(100):
        cell = dempster(cell, hit)
    assert cell[UNKNOWN] == pytest.approx(0.030425, abs=5e-7)
    assert cell[OCCUPIED] == pytest.approx(0.963336, abs=5e-7)


def test_pignistic_values():
    beliefs = [VACUOUS, SURELY_FREE, SURELY_OCCUPIED, FULL_CONFLICT, [0.5, 0.25, 0.0, 0.25], [0, 0.1, 0.3, 0.6]]
    np.testing.assert_allclose(pignistic(beliefs), [0.5, 0.0, 1.0, 0.5, 0.25, 0.6])


def test_full_conflict_normalises_to_ignorance():
    np.testing.assert_array_equal(normalise(FULL_CONFLICT), VACUOUS)
    np.testing.assert_array_equal(dempster(SURELY_FREE, SURELY_OCCUPIED), VACUOUS)


def test_discounting_gives_the_rest_to_unknown():
    np.testing.assert_allclose(discount([0.1, 0.2, 0.4, 0.3], 0.5), [0.05, 0.1, 0.2, 0.65])


def test_shapes_broadcast_and_inputs_stay_as_they_are():
    grid = np.tile([0.0, 0.5, 0.25, 0.25], (3, 4, 1))
    before = grid.copy()
    for rule in (conjunctive, disjunctive, dempster):
        combined = rule(grid, [0.0, 0.0, 0.5, 0.5])
        assert combined.shape == (3, 4, 4)
        np.testing.assert_array_equal(combined[2, 3], rule(grid[0, 0], [0.0, 0.0, 0.5, 0.5]))
    reliability = np.linspace(0.0, 1.0, 12).reshape(3, 4)
    assert discount(grid, reliability)[2, 3] == pytest.approx(grid[0, 0])
    np.testing.assert_array_equal(pignistic(grid), 0.375)
    np.testing.assert_array_equal(grid, before)


def test_float32_masses_are_computed_in_double():
    assert conjunctive(np.float32(VACUOUS), np.float32(VACUOUS)).dtype == np.float64


def test_the_vacuous_belief_is_constant():
    with pytest.raises(ValueError, match="read-only"):
        VACUOUS[CONFLICT] = 1.0


@pytest.mark.parametrize("masses", [[0.5, 0.5], [[0.2] * 5], 1.0])
@pytest.mark.parametrize(
    "function", [normalise, pignistic, lambda m: conjunctive(m, VACUOUS), lambda m: discount(m, 1)]
)
def test_other_than_four_masses_is_refused(masses, function):
    with pytest.raises(ValueError, match="masses must have four entries in the last axis, got shape"):
        function(masses)


@pytest.mark.parametrize("reliability", [-0.1, 1.1, [0.5, 2.0]])
def test_reliability_outside_its_range_is_refused(reliability):
    with pytest.raises(ValueError, match=r"reliability must lie within \[0, 1\], got"):
        discount(VACUOUS, reliability)
