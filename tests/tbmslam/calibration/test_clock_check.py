import pytest

from tbmslam.calibration.clock_check import clock_warning
from tbmslam.calibration.hand_eye import Lag, SensorPlace

PLACE = SensorPlace((0.2, 0.0, 0.0), (0.01, 0.01, 0.01), 1.0, 0.0, 0.005)


@pytest.mark.parametrize(("lag", "words"), [(0.2, "0.20 s older"), (-0.2, "0.20 s newer")])
def test_a_lag_is_named_with_its_remedy(lag, words):
    warning = clock_warning(PLACE._replace(lag=lag), None, 1.0)
    assert words in warning
    assert warning.endswith(f"--clock-offset {1.0 + lag:.2f}")


def test_small_and_uncertain_lags_are_no_reason_for_a_warning():
    assert clock_warning(PLACE._replace(lag=0.11), None, 0.0) is None
    assert clock_warning(PLACE._replace(lag=0.5, lag_deviation=0.04), None, 0.0) is None


def test_the_lag_by_rotations_is_named_if_it_is_known():
    assert clock_warning(PLACE._replace(lag=-0.2), Lag(-0.3, 0.035), 1.0).endswith("--clock-offset 0.70")
    assert clock_warning(PLACE._replace(lag=-0.2), Lag(-0.11, 0.01), 1.0) is None
    assert clock_warning(PLACE._replace(lag=-0.11), Lag(-0.3, 0.01), 1.0) is None


@pytest.mark.parametrize("turned", [Lag(-0.3, 0.11), Lag(-0.3, 0.041), Lag(0.3, 0.01), Lag(0.0, 0.01)])
def test_an_unsure_or_contrary_lag_by_rotations_is_not_used(turned):
    assert clock_warning(PLACE._replace(lag=-0.2), turned, 1.0).endswith("--clock-offset 0.80")
