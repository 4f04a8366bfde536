"""The probability that the odometry is faulty."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tbmslam.geometry.se2 import SE2
from tbmslam.tracking.odometry_fault import OdometryFault, faulty_cost
from tbmslam.tracking.student_t import FREEDOM, student_cost

_PLAUSIBLE, _IMPOSSIBLE = 1.0, 1000.0
"""Squared Mahalanobis distances of right odometry, and of odometry that reports the opposite direction."""
_FAULTY = 5.0
"""Cost of a pose under faulty odometry."""
_DEVIATIONS = (0.02, 0.02, 0.01)


def test_a_new_drive_trusts_its_odometry() -> None:
    fault = OdometryFault()
    assert not fault.is_suspected
    assert fault.cost(_PLAUSIBLE, _FAULTY) == pytest.approx(student_cost(_PLAUSIBLE), abs=0.02)


def test_any_pose_under_faulty_odometry_costs_about_the_same() -> None:
    fault = OdometryFault()
    assert fault.cost(_IMPOSSIBLE, _FAULTY) < student_cost(_IMPOSSIBLE) - 3.0
    assert fault.cost(1e3 * _IMPOSSIBLE, _FAULTY) == pytest.approx(fault.cost(_IMPOSSIBLE, _FAULTY), abs=0.02)


def test_the_first_keyframe_of_a_fault_needs_more_evidence_than_the_next() -> None:
    fault = OdometryFault()
    first = fault.cost(_IMPOSSIBLE, _FAULTY)
    fault.observe(_IMPOSSIBLE, _FAULTY)
    assert fault.is_suspected
    assert first > fault.cost(_IMPOSSIBLE, _FAULTY) + 4.0


def test_faulty_odometry_costs_what_its_volume_says() -> None:
    """The density of right odometry at its mean, over that of a uniform distribution in an ellipsoid."""
    right, inertia = (0.01, 0.005, 0.004), (0.2, 0.1, 0.3)
    density = stats.multivariate_t(shape=np.diag(np.square(right)), df=FREEDOM).pdf([0.0, 0.0, 0.0])
    volume = 4.0 / 3.0 * math.pi * math.prod(inertia)
    assert faulty_cost(right, inertia) == pytest.approx(math.log(density * volume))


def test_the_odometry_before_a_fault_is_remembered_until_it_ends() -> None:
    fault, pose = OdometryFault(), SE2(3.0, 1.0, 0.5)
    fault.remember(SE2(0.3, 0.1, 0.2), SE2.identity(), _DEVIATIONS)
    assert fault.returned(pose, _DEVIATIONS) is None  # without a fault every correction counts
    by_odometry, by_scans = (SE2(1.0, 0.0, 1.0), SE2(2.2, 0.5, -1.0)), (SE2(0.5, 0.2, 0.3), SE2(1.5, 0.7, 0.1))
    anchor = SE2.identity()  # the odometry's frame in the map
    for odometry, scan in zip(by_odometry, by_scans, strict=True):
        fault.observe(_IMPOSSIBLE, _FAULTY)
        fault.remember(anchor @ odometry, scan, _DEVIATIONS)
        anchor = scan @ odometry.inverse()
    found = fault.returned(anchor @ pose, _DEVIATIONS)
    assert found is not None
    assert found[0] == pytest.approx(pose)
    assert found[1] == pytest.approx([math.sqrt(3.0) * d for d in _DEVIATIONS])
    fault.observe(_PLAUSIBLE, _FAULTY)
    assert fault.returned(pose, _DEVIATIONS) is None


def test_odometry_that_began_anew_has_no_pose_before_the_fault() -> None:
    fault = OdometryFault()
    fault.observe(_IMPOSSIBLE, _FAULTY)
    fault.remember(SE2(0.3, 0.1, 0.2), SE2.identity(), _DEVIATIONS)
    assert fault.returned(SE2.identity(), _DEVIATIONS) is not None
    fault.forget()
    assert fault.is_suspected
    assert fault.returned(SE2.identity(), _DEVIATIONS) is None


def test_odometry_that_is_again_as_before_a_fault_is_right() -> None:
    fault = OdometryFault()
    fault.observe(_IMPOSSIBLE, _FAULTY)
    assert fault.cost(_IMPOSSIBLE, _FAULTY, 0.5) < fault.cost(_IMPOSSIBLE, _FAULTY)
    fault.observe(_IMPOSSIBLE, _FAULTY, 0.5)
    assert not fault.is_suspected


def test_right_odometry_is_trusted_again_after_a_keyframe() -> None:
    fault = OdometryFault()
    fault.observe(_IMPOSSIBLE, _FAULTY)
    assert fault.is_suspected
    fault.observe(_PLAUSIBLE, _FAULTY)
    assert not fault.is_suspected


@given(st.lists(st.floats(0.0, 1e6), max_size=30), st.floats(0.0, 1e6), st.floats(0.0, 1e3))
def test_a_farther_pose_never_costs_less_and_probabilities_stay_possible(
    observed: list[float], surprise: float, more: float
) -> None:
    fault = OdometryFault()
    for distance in observed:
        fault.observe(distance, _FAULTY)
        assert 1e-3 <= fault.probability <= 0.9
    assert fault.cost(surprise, _FAULTY) <= fault.cost(surprise + more, _FAULTY) + 1e-9
    assert math.isfinite(fault.cost(surprise, _FAULTY))
