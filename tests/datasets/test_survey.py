import math

import numpy as np
import pytest

from datasets.options import RecordingOptions
from datasets.scan_intake import RawScan
from datasets.survey import Survey


def surveyed(stamps):
    survey = Survey(RecordingOptions())
    for stamp in stamps:
        survey.add_scan("laser", RawScan(stamp, -1.0, 0.1, 0.1, 30.0, np.ones(3)), stamp)
    return survey


def test_a_scan_takes_no_longer_than_the_next_is_away():
    assert surveyed([0.0, 0.1, 0.2, 0.1, 0.2, 9.0, 9.1]).longest_sweep() == pytest.approx(0.11)
    assert surveyed([1.0]).longest_sweep() == math.inf


def test_an_unset_stamp_tells_no_lag():
    survey = surveyed([math.nan, 1.0])
    survey.add_pose("/odom", "odom", "base_link", math.nan)
    survey.add_pose("/odom", "odom", "base_link", 0.5)
    assert survey.scan_lags == [0.0]
    assert survey.pose_topics["/odom"].lags == [0.5]
