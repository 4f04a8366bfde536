import math

import numpy as np
import pytest

from merging.experiments.descriptor_matches import Described, match_all

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


def test_the_nearest_is_matched_and_its_ratio_told():
    target = Described(POINTS, np.array([[0b0], [0b1111], [0b11111111]], dtype=np.uint8))
    source = Described(POINTS[:1], np.array([[0b1]], dtype=np.uint8))
    matches = match_all(target, source)
    np.testing.assert_array_equal(matches.target_points, [[0.0, 0.0]])
    assert matches.ratios[0] == pytest.approx(1.0 / 3.0)
    assert len(matches.clearer_than(0.3).ratios) == 0
    assert len(matches.clearer_than(0.4).ratios) == 1


def test_equally_near_is_not_clear():
    target = Described(POINTS, np.zeros((3, 1), dtype=np.uint8))
    assert match_all(target, target).ratios.tolist() == [1.0, 1.0, 1.0]


def test_one_descriptor_matches_nothing(pair):
    alone = Described(POINTS[:1], np.zeros((1, 1), dtype=np.uint8))
    matches = match_all(alone, alone)
    assert len(matches.ratios) == 0
    assert math.isnan(matches.share_right(pair, 0.5))
