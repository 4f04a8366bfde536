import cv2
import numpy as np

from tools.calibration.calibration_report import acceptance_table, calibration_table, draw_calibration
from tools.calibration.trial import Judgement

JUDGED = [
    Judgement("crop_a_100", 0.95, True),
    Judgement("crop_a_015", 0.75, False),
    Judgement("crop_b_015", 0.65, True),
    Judgement("negs_a_1", 0.55, False),
]


def test_the_table_counts_what_would_be_accepted():
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in acceptance_table(JUDGED).splitlines()[2:]]
    assert rows[0] == ["0.5", "1/1", "1/2", "1", "1 of 1"]
    assert rows[2] == ["0.7", "1/1", "0/2", "1", "0 of 1"]


def test_confidences_are_held_against_what_came_true():
    assert "0.50 to 1.00 | 4     |       0.725 |        0.500" in calibration_table(JUDGED, (0.0, 0.5, 1.0))


def test_each_bin_is_drawn():
    """Also bins in which all answers are right, or none."""
    edges = (0.0, 0.6, 0.7, 0.8, 1.0)
    drawn = draw_calibration(JUDGED, edges)
    assert draw_calibration(JUDGED, edges) == drawn
    blue = np.ptp(cv2.imdecode(np.frombuffer(drawn, np.uint8), cv2.IMREAD_COLOR).astype(int), axis=2) > 100
    dots = cv2.erode(blue.astype(np.uint8), np.ones((7, 7)))  # without the intervals
    assert cv2.connectedComponents(dots)[0] - 1 == 4
