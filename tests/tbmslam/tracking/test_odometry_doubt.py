import numpy as np
import pytest

from tbmslam.se2 import SE2
from tbmslam.tracking.odometry_doubt import OdometryDoubt, OdometryDoubtConfig

STATED = np.array([0.02, 0.02, 0.01])


def factors_of(doubt):
    return np.array([doubt.of_position, doubt.of_position, doubt.of_heading])


def taught(truth, information, scans=600, config=None, seed=0):
    """Return what is learned of odometry with true deviations (3,), from scans laid onto surfaces."""
    doubt = OdometryDoubt(config or OdometryDoubtConfig(memory=300.0))
    generator = np.random.default_rng(seed)
    noise = np.linalg.inv(np.linalg.cholesky(information + 1e-9 * np.eye(3))).T
    for _ in range(scans):
        deviations = STATED * factors_of(doubt)
        prior = np.diag(deviations**-2.0)
        error = generator.normal(0.0, 1.0, 3) * truth
        measured = error + noise @ generator.normal(0.0, 1.0, 3)
        found = np.linalg.solve(information + prior, information @ measured)
        doubt.note(SE2(1.0, 2.0, 3.0), SE2(1.0 + found[0], 2.0 + found[1], 3.0 + found[2]), deviations, information)
    return factors_of(doubt)


def test_true_errors_are_learned_through_noisy_scans():
    factors = taught(STATED * [3.0, 3.0, 5.0], np.diag([1e4, 4e3, 1e4]))
    assert factors == pytest.approx([3.0, 3.0, 5.0], rel=0.15)


def test_odometry_better_than_stated_is_left_as_it_is():
    assert taught(STATED * 0.5, np.diag([1e4, 1e4, 1e5])) == pytest.approx([1.0, 1.0, 1.0])


def test_along_a_featureless_wall_nothing_is_learned():
    # Only across: the wheels' slip along the wall shows in no scan.
    factors = taught(STATED * [8.0, 1.0, 1.0], np.diag([0.0, 1e5, 1e5]))
    assert factors == pytest.approx([1.0, 1.0, 1.0], abs=0.15)


def test_a_single_wild_correction_is_not_the_rule():
    doubt = OdometryDoubt(OdometryDoubtConfig())
    for step in range(200):
        doubt.note(
            SE2.identity(), SE2(5.0 if step == 100 else 0.0, 0.0, 0.0), STATED * factors_of(doubt), np.eye(3) * 1e5
        )
        if step == 100:
            assert 1.0 < doubt.of_position < 2.0
    assert factors_of(doubt) == pytest.approx([1.0, 1.0, 1.0])
    for _ in range(200):
        doubt.note(SE2.identity(), SE2(5.0, 0.0, 3.0), STATED * factors_of(doubt), np.eye(3) * 1e9)
    assert factors_of(doubt).max() <= 10.0


def test_the_stated_errors_can_be_kept():
    assert taught(STATED * 5.0, np.eye(3) * 1e5, config=OdometryDoubtConfig(enabled=False)).tolist() == [1.0, 1.0, 1.0]
