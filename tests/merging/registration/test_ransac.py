import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merging.config.registration import ConsensusConfig
from merging.registration.features import Matches
from merging.registration.ransac import find_consensus
from tbmslam.geometry.se2 import SE2

CONFIG = ConsensusConfig()
motions = st.builds(SE2, st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi - 1e-9))


def matches_under(motion, rng, right=12, wrong=0, noise=0.05, scale=1.0):
    source = rng.uniform(-10.0, 10.0, size=(right + wrong, 2))
    target = motion.apply(scale * source) + rng.normal(0.0, noise, size=source.shape)
    target[right:] = motion.apply(rng.uniform(-10.0, 10.0, size=(wrong, 2)))
    return Matches(target, source)


def assert_same_motion(found, expected, metres=1e-6, radians=1e-6):
    x, y, theta = (expected.inverse() @ found).log()
    assert math.hypot(x, y) <= metres
    assert abs(theta) <= radians


@settings(deadline=None, max_examples=30)
@given(motion=motions, seed=st.integers(0, 1000))
def test_the_right_matches_win_over_twice_as_many_wrong_ones(motion, seed):
    consensus = find_consensus(matches_under(motion, np.random.default_rng(seed), right=12, wrong=24), CONFIG)
    assert consensus.inliers[:12].all()
    assert consensus.count <= 16
    assert_same_motion(consensus.T_target_source, motion, metres=0.3, radians=0.03)
    assert consensus.rmse_m < 0.2
    assert consensus.scale == pytest.approx(1.0, abs=0.03)


def test_hundreds_of_matches_are_sampled_and_still_the_same_every_time():
    matches = matches_under(SE2(1.0, 2.0, 3.0), np.random.default_rng(0), right=150, wrong=250)
    first, second = find_consensus(matches, CONFIG), find_consensus(matches, CONFIG)
    assert first.T_target_source == second.T_target_source
    assert first.inliers[:150].mean() > 0.98
    assert_same_motion(first.T_target_source, SE2(1.0, 2.0, 3.0), metres=0.05, radians=0.01)


@pytest.mark.parametrize("scale", [0.5, 0.8, 1.25, 2.0])
def test_a_map_of_another_scale_is_recognised_as_such(scale):
    consensus = find_consensus(
        matches_under(SE2(5.0, 1.0, 2.0), np.random.default_rng(1), right=15, scale=scale), CONFIG
    )
    assert consensus.count >= 12
    assert consensus.scale == pytest.approx(scale, abs=0.03)


@pytest.mark.parametrize("count", [0, 1])
def test_nothing_to_pair_proposes_nothing(count):
    points = np.arange(2.0 * count).reshape(-1, 2)
    assert find_consensus(Matches(points, points), CONFIG) is None


def test_matches_on_one_spot_propose_nothing():
    points = np.full((20, 2), 3.0)
    assert find_consensus(Matches(points, points), CONFIG) is None


def test_matches_beyond_the_inlier_distance_all_cost_the_same():
    """Ten exact matches with eight more just beyond the distance lose against twelve exact ones."""
    generator, reach = np.random.default_rng(3), CONFIG.inlier_distance_m
    source = generator.uniform(-10.0, 10.0, size=(30, 2))
    target = source.copy()
    target[12:] += (20.0 * reach, 0.0)
    target[22:26, 1] += 1.5 * reach
    target[26:, 1] -= 1.5 * reach
    consensus = find_consensus(Matches(target, source), CONFIG)
    assert np.flatnonzero(consensus.inliers).tolist() == list(range(12))
    assert_same_motion(consensus.T_target_source, SE2.identity())
