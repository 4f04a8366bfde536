import math

import numpy as np
import pytest

from merging.experiments.descriptor_matches import DescriptorMatches
from merging.experiments.detectors import DETECTORS, compare_detectors, share_of_inliers


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
