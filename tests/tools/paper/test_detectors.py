import math

import numpy as np
import pytest

from tools.paper.detectors import (
    DETECTORS,
    Described,
    DescriptorMatches,
    compare_detectors,
    match_all,
    share_of_inliers,
)

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


def test_the_nearest_descriptor_is_matched_with_its_ratio():
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


def test_every_detector_finds_its_keypoints_again(pair):
    results = compare_detectors(pair, 300, 0.8, 0.5)
    assert list(results) == list(DETECTORS) == ["ORB", "BRISK", "SIFT", "AKAZE"]
    for name, result in results.items():
        assert result.matches >= 10, name
        assert result.share_right > 0.7, name
        assert result.share_inliers > 0.4, name


def test_inliers_of_an_affine_transform():
    generator = np.random.default_rng(0)
    source = generator.uniform(0.0, 10.0, (20, 2))
    target = source @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + 2.0
    target[:5] += generator.uniform(3.0, 5.0, (5, 2))
    matches = DescriptorMatches(target, source, np.zeros(20))
    assert share_of_inliers(matches, 0.1) == pytest.approx(0.75)
    assert math.isnan(share_of_inliers(DescriptorMatches(target[:2], source[:2], np.zeros(2)), 0.1))
