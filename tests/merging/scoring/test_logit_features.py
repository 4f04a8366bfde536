from dataclasses import replace

import numpy as np

from merging.scoring.logit_features import MEASURES, by_chance, measured
from merging.verification.wall_segments import Pieces
from tests.merging.judged_places import CHANCE, GOOD


def test_every_number_has_its_place():
    assert measured([GOOD, CHANCE]).shape == (2, len(MEASURES))
    assert measured([]).shape == (0, len(MEASURES))


def test_a_large_overlap_half_of_which_agrees_speaks_for_nothing():
    """So it is by chance: of a ring of rooms laid on its mirror image much agrees, and as much does not."""
    ring = replace(GOOD, overlap_m2=500.0, compared_wall_m=160.0, agreed_wall_m=80.0, pieces=Pieces(90, 50, 180, 30))
    found = dict(zip(MEASURES, measured([ring])[0], strict=True))
    assert found["overlap beyond chance"] == found["corners beyond chance"] == found["surprise"] == 0.0


def test_chance_is_the_best_decoy_or_the_third_candidate():
    score = np.ones(len(MEASURES))
    good, chance = measured([GOOD]), measured([CHANCE])
    nothing = np.zeros((0, len(MEASURES)))
    np.testing.assert_array_equal(by_chance(good, nothing, score), 0.0)
    np.testing.assert_array_equal(by_chance(good, chance, score), chance[0])
    np.testing.assert_array_equal(by_chance(measured([GOOD, GOOD, CHANCE]), nothing, score), chance[0])
    np.testing.assert_array_equal(by_chance(chance, np.vstack((chance, good)), score), good[0])
