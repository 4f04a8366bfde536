import numpy as np
import pytest

from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN, pignistic
from tbmslam.belief.occupancy import RELIABILITY, masses_from_probability
from tests.belief_rules import discount

PROBABILITIES = np.linspace(0.0, 1.0, 101)


def test_they_are_beliefs():
    masses = masses_from_probability(PROBABILITIES, PROBABILITIES < 2.0)
    assert masses.dtype == np.float32
    assert (masses >= 0.0).all()
    np.testing.assert_allclose(masses.sum(axis=-1), 1.0, atol=1e-6)


def test_undiscounted_they_would_bet_the_given_probability():
    lean = 2.0 * PROBABILITIES - 1.0
    certain = np.zeros((101, 4))
    certain[:, OCCUPIED], certain[:, FREE] = np.maximum(lean, 0.0), np.maximum(-lean, 0.0)
    certain[:, UNKNOWN] = 1.0 - abs(lean)
    np.testing.assert_allclose(pignistic(certain), PROBABILITIES, atol=1e-12)
    masses = masses_from_probability(PROBABILITIES, np.ones(101, dtype=bool))
    np.testing.assert_allclose(masses, discount(certain, RELIABILITY), atol=1e-6)


@pytest.mark.parametrize(
    ("probability", "known", "expected"),
    [
        (1.0, True, [0.0, 0.0, 0.9, 0.1]),
        (0.0, True, [0.0, 0.9, 0.0, 0.1]),
        (0.5, True, [0.0, 0.0, 0.0, 1.0]),
        (1.0, False, [0.0, 0.0, 0.0, 1.0]),
    ],
)
def test_certain_even_and_unknown(probability, known, expected):
    np.testing.assert_allclose(masses_from_probability(np.array(probability), np.array(known)), expected, atol=1e-6)
