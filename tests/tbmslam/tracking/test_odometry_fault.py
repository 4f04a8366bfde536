"""The probability that the odometry is faulty."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.tracking.odometry_fault import OdometryFault
from tbmslam.tracking.odometry_noise import student_cost

_PLAUSIBLE, _IMPOSSIBLE = 1.0, 300.0
"""Squared Mahalanobis distances of right odometry, and of odometry that reports the opposite direction."""


def test_a_new_drive_trusts_its_odometry() -> None:
    fault = OdometryFault()
    assert not fault.is_suspected
    assert fault.cost(_PLAUSIBLE) == pytest.approx(student_cost(_PLAUSIBLE), abs=0.02)


def test_any_pose_under_faulty_odometry_costs_about_the_same() -> None:
    fault = OdometryFault()
    assert fault.cost(_IMPOSSIBLE) < student_cost(_IMPOSSIBLE) - 3.0
    assert fault.cost(1e3 * _IMPOSSIBLE) == pytest.approx(fault.cost(_IMPOSSIBLE), abs=0.02)


def test_the_first_keyframe_of_a_fault_needs_more_evidence_than_the_next() -> None:
    fault = OdometryFault()
    first = fault.cost(_IMPOSSIBLE)
    fault.observe(_IMPOSSIBLE)
    assert fault.is_suspected
    assert first > fault.cost(_IMPOSSIBLE) + 4.0


def test_right_odometry_is_trusted_again_after_some_keyframes() -> None:
    fault = OdometryFault()
    fault.observe(_IMPOSSIBLE)
    for keyframe in range(2):
        assert fault.is_suspected, keyframe
        fault.observe(_PLAUSIBLE)
    assert not fault.is_suspected


@given(st.lists(st.floats(0.0, 1e6), max_size=30), st.floats(0.0, 1e6), st.floats(0.0, 1e3))
def test_a_farther_pose_never_costs_less_and_probabilities_stay_possible(
    observed: list[float], surprise: float, more: float
) -> None:
    fault = OdometryFault()
    for distance in observed:
        fault.observe(distance)
        assert 1e-2 <= fault.probability <= 0.9
    assert fault.cost(surprise) <= fault.cost(surprise + more) + 1e-9
    assert math.isfinite(fault.cost(surprise))
