import pytest

from tbmslam.calibration.clock_check import clock_warning
from tbmslam.calibration.hand_eye import SensorPlace

PLACE = SensorPlace((0.2, 0.0, 0.0), (0.01, 0.01, 0.01), 1.0, 0.0, 0.005)


@pytest.mark.parametrize(("lag", "words"), [(0.2, "0.20 s older"), (-0.2, "0.20 s newer")])
def test_a_lag_is_named_with_its_remedy(lag, words):
    warning = clock_warning(PLACE._replace(lag=lag), 1.0)
    assert words in warning
    assert warning.endswith(f"--clock-offset {1.0 + lag:.2f}")


def test_small_and_uncertain_lags_are_no_reason_for_a_warning():
    assert clock_warning(PLACE._replace(lag=0.11), 0.0) is None
    assert clock_warning(PLACE._replace(lag=0.5, lag_deviation=0.04), 0.0) is None
