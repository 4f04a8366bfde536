import math

import numpy as np
import pytest

from merging.alignment import Alignment, PoseHypothesis, deviations, seen_from
from tbmslam.geometry.se2 import SE2

COVARIANCE = ((0.04, 0.01, -0.002), (0.01, 0.09, 0.003), (-0.002, 0.003, 0.0004))
PLACE, ELSEWHERE = SE2(3.0, -2.0, 1.0), SE2(-7.0, 1.0, 2.5)
FOUND = Alignment(
    "correlation",
    True,
    "",
    PLACE,
    covariance=COVARIANCE,
    alternatives=(PoseHypothesis(ELSEWHERE, 0.1, 5.0, COVARIANCE),),
)


def test_a_reversed_alignment_has_the_inverse_pose():
    back = FOUND.reversed()
    assert back.T_target_source == PLACE.inverse()
    assert back.alternatives[0].T_target_source == ELSEWHERE.inverse()
    assert back.covariance == seen_from(COVARIANCE, PLACE)
    assert deviations(back.covariance) == pytest.approx(deviations(COVARIANCE), rel=1e-6)
    again = back.reversed()
    assert again.T_target_source == pytest.approx(PLACE)
    np.testing.assert_allclose(again.covariance, COVARIANCE, atol=1e-9)


def test_unknown_poses_and_covariances_stay_unknown_in_reverse():
    assert Alignment("correlation", False, "").reversed() == Alignment("correlation", False, "")
    assert Alignment("hough", True, "", SE2(1.0, 0.0, math.pi / 2.0)).reversed().covariance is None


def test_an_alignment_is_written_with_lists_of_numbers():
    written = FOUND.as_json()
    assert written["T_target_source"] == list(PLACE)
    assert written["covariance"] == COVARIANCE
    assert written["alternatives"][0]["T_target_source"] == list(ELSEWHERE)


def test_it_is_shown_in_a_line():
    found = Alignment("correlation", True, "confidence 0.986", SE2(3.0, -2.0, math.pi / 2.0))
    assert repr(found) == "Alignment(accepted, x 3.000 m, y -2.000 m, turned 90.00 degrees: confidence 0.986)"
    assert repr(Alignment("correlation", False, "the map is empty")) == "Alignment(refused: the map is empty)"
