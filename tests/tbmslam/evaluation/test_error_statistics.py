import numpy as np
import pytest

from tbmslam.evaluation.error_statistics import ErrorStatistics


def test_figures_of_a_known_set():
    statistics = ErrorStatistics.of(np.array([0.0, 3.0, 4.0, 1.0]))
    assert statistics.rmse == pytest.approx(np.sqrt(26 / 4))
    assert statistics.mean == pytest.approx(2.0)
    assert statistics.standard_deviation == pytest.approx(np.sqrt(26 / 4 - 4))
    assert statistics.median == pytest.approx(2.0)
    assert statistics.maximum == pytest.approx(4.0)


def test_nothing_cannot_be_summed_up():
    with pytest.raises(ValueError, match="errors must hold at least one value, got none"):
        ErrorStatistics.of(np.zeros(0))
