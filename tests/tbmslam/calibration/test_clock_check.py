import pytest

from tbmslam.calibration.clock_check import clock_warning
from tbmslam.calibration.hand_eye import SensorPlace

PLACE = SensorPlace((0.2, 0.0, 0.0), (0.01, 0.01, 0.01), 1.0, 0.0, 0.005)


@pytest.mark.parametrize("lag", [0.2, -0.2])
def test_a_lag_is_named_with_its_remedy(lag):
    assert f"differ by 0.20 s: try --clock-offset {lag:.2f} " in clock_warning(PLACE._replace(lag=lag))


def test_small_and_uncertain_lags_are_no_reason_for_a_warning():
    assert clock_warning(None) is None
    assert clock_warning(PLACE._replace(lag=0.11)) is None
    assert clock_warning(PLACE._replace(lag=0.5, lag_deviation=0.04)) is None
