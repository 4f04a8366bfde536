import numpy as np
import pytest

from tbmslam.tracking.noise_factor import NoiseFactor


@pytest.mark.parametrize("true", [0.01, 0.3, 5.0, 100.0])
def test_the_factor_is_the_ratio_of_the_true_deviation_to_the_stated_one_within_bounds(true):
    factor, generator = NoiseFactor(100.0, 3.0), np.random.default_rng(0)
    for _ in range(300):
        factor.learn(1.0, generator.normal(0.0, true), factor.value, factor.value, 1.0)
    assert factor.value == pytest.approx(np.clip(true, 0.05, 20.0), rel=0.2)


def test_a_coordinate_that_no_scan_determined_teaches_nothing():
    factor = NoiseFactor(100.0, 3.0)
    for _ in range(10_000):
        factor.learn(1.0, 0.0, 1.0, 1.0, 0.0)
    assert factor.value == pytest.approx(1.0)


def test_the_stated_deviation_counts_as_some_corrections():
    few, many = NoiseFactor(100.0, 1.0), NoiseFactor(100.0, 50.0)
    for factor in (few, many):
        factor.learn(1.0, 3.0, 1.0, 1.0, 1.0)
    assert few.value > 2.0 > many.value > 1.0
