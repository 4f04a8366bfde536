"""Masses, and the plain rules of the tests, on values known from elsewhere."""

import numpy as np
import pytest

from tbmslam.belief.masses import CONFLICT, OCCUPIED, UNKNOWN, VACUOUS, pignistic
from tests.belief_rules import dempster

SURELY_FREE = np.array([0.0, 1.0, 0.0, 0.0])
SURELY_OCCUPIED = np.array([0.0, 0.0, 1.0, 0.0])
FULL_CONFLICT = np.array([1.0, 0.0, 0.0, 0.0])


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


def test_the_vacuous_belief_is_constant():
    with pytest.raises(ValueError, match="read-only"):
        VACUOUS[CONFLICT] = 1.0


@pytest.mark.parametrize("masses", [[0.5, 0.5], [[0.2] * 5], 1.0])
def test_other_than_four_masses_is_refused(masses):
    with pytest.raises(ValueError, match="masses must have four entries in the last axis, got shape"):
        pignistic(masses)
