import numpy as np
import pytest

from tbmslam.tracking.odometry_noise import OdometryNoise, OdometryNoiseConfig
from tbmslam.tracking.student_t import FREEDOM

STEP, TURN = 0.3, 0.1


def weighed(measured, variances, deviations):
    """Return the largest posterior of a measurement and a prior of Student's t distribution around zero."""
    found = measured
    for _ in range(12):
        weight = (FREEDOM + 3.0) / (FREEDOM + np.sum((found / deviations) ** 2))
        found = measured / (1.0 + weight * variances / deviations**2)
    return found


def taught(factors, share, slips=0.0, seed=0, config=None):
    """Return the factors learnt in 200 keyframes from odometry with errors larger by some factors (3,) than stated.

    `share` is the part of each coordinate that the scans determine against odometry as stated, and `slips` the share of
    motions with errors of 20 deviations.
    """
    noise, generator = OdometryNoise(config or OdometryNoiseConfig()), np.random.default_rng(seed)
    stated = np.array(noise.deviations(STEP, TURN))
    # Odometry of deviation d and scans of variance r determine the share d^2 / (d^2 + r).
    variances = stated**2 * (1.0 / np.maximum(np.broadcast_to(share, 3), 1e-12) - 1.0)
    for _ in range(200):
        error = generator.normal(0.0, 1.0, 3) * stated * factors
        if generator.uniform() < slips:
            error = 20.0 * stated * factors * generator.choice([-1.0, 1.0], 3)
        measured = error + np.sqrt(variances) * generator.normal(0.0, 1.0, 3)
        deviations = np.array(noise.deviations(STEP, TURN))
        found = weighed(measured, variances, deviations)
        shares = deviations**2 / (deviations**2 + variances)
        motion = tuple(deviations.tolist())
        noise.learn(tuple(found.tolist()), motion, motion, tuple(shares.tolist()))
    return np.array(noise.factors)


def ratios(factors, share, **keywords):
    """Return by which factors (3,) the estimate is too large, in the median of several drives."""
    return np.median([taught(factors, share, seed=seed, **keywords) for seed in range(7)], axis=0) / factors


@pytest.mark.parametrize("factors", [(1.0, 1.0, 1.0), (0.3, 0.3, 0.3), (4.0, 4.0, 4.0), (3.0, 0.5, 6.0)])
def test_true_deviations_are_learnt_for_each_axis(factors):
    assert ratios(factors, 1.0) == pytest.approx([1.0] * 3, rel=0.26)


@pytest.mark.parametrize(
    ("factors", "within"), [((1.0, 1.0, 1.0), 0.36), ((4.0, 4.0, 4.0), 0.17), ((3.0, 0.5, 6.0), 0.5)]
)
def test_scans_that_determine_little_teach_almost_as_well(factors, within):
    assert ratios(factors, 0.3) == pytest.approx([1.0] * 3, rel=within)


def test_a_keyframe_of_unknown_pose_teaches_nothing_about_the_motion():
    """After a gap the keyframe's own pose is unknown, and the next scan is registered to that keyframe alone."""
    noise = OdometryNoise(OdometryNoiseConfig())
    before, motion = noise.factors, noise.deviations(STEP, TURN)
    noise.learn((0.0, 0.0, 0.0), tuple(30.0 * deviation for deviation in motion), motion, (1.0, 1.0, 1.0))
    assert noise.factors == pytest.approx(before, rel=0.05)


def test_odometry_that_is_better_than_scans_can_tell_is_believed_more():
    learnt = 0.3 * ratios((0.3, 0.3, 0.3), 0.3)
    assert 0.3 < learnt.min() < learnt.max() < 0.55


@pytest.mark.parametrize("factors", [(1.0, 1.0, 1.0), (0.3, 0.3, 0.3), (3.0, 0.5, 6.0)])
def test_slips_are_not_the_rule(factors):
    """Squares without Student's t would make it six times as much."""
    changed = ratios(factors, 1.0, slips=0.1) / ratios(factors, 1.0)
    assert changed.min() > 1.0
    assert changed.max() < 1.3


def test_nothing_is_learnt_of_what_no_scan_determines():
    assert taught((5.0, 5.0, 5.0), 0.0) == pytest.approx([1.0] * 3, abs=1e-6)
    along, across, turning = taught((5.0, 2.0, 2.0), (0.0, 1.0, 1.0))
    assert along == pytest.approx(1.0, abs=1e-6)
    assert (across, turning) == pytest.approx((2.0, 2.0), rel=0.26)


def test_the_stated_deviations_can_be_kept():
    assert taught((5.0, 5.0, 5.0), 1.0, config=OdometryNoiseConfig(learning=False)).tolist() == [1.0] * 3


def test_factors_are_bounded():
    noise = OdometryNoise(OdometryNoiseConfig())
    for _ in range(2000):
        now = noise.deviations(STEP, TURN)
        noise.learn((0.0, 0.0, 0.0), now, now, (1.0, 1.0, 1.0))
    assert noise.factors == (0.05, 0.05, 0.05)
    for _ in range(2000):
        now = noise.deviations(STEP, TURN)
        noise.learn((1e3, 1e3, 1e3), now, now, (1.0, 1.0, 1.0))
    assert noise.factors == (20.0, 20.0, 20.0)


def test_what_the_odometry_was_like_long_ago_fades():
    noise = OdometryNoise(OdometryNoiseConfig(memory=20.0))
    stated = np.array(noise.deviations(STEP, TURN))
    for factor in (5.0, 1.0):
        for k in range(150):
            error = tuple((factor * stated * (-1.0) ** k).tolist())
            now = noise.deviations(STEP, TURN)
            noise.learn(error, now, now, (1.0, 1.0, 1.0))
    assert noise.factors == pytest.approx((1.0,) * 3, rel=0.1)


def test_what_the_keyframe_before_explains_is_not_held_against_the_odometry():
    noise, generator = OdometryNoise(OdometryNoiseConfig()), np.random.default_rng(0)
    stated = np.array(noise.deviations(STEP, TURN))
    for _ in range(300):
        now = np.array(noise.deviations(STEP, TURN))
        together = np.sqrt(now**2 + (3.0 * stated) ** 2)
        error = generator.normal(0.0, 1.0, 3) * np.sqrt(1.0 + 3.0**2) * stated
        noise.learn(tuple(error.tolist()), tuple(together.tolist()), tuple(now.tolist()), (1.0, 1.0, 1.0))
    assert max(noise.factors) < 1.5
