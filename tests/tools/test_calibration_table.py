import numpy as np

from tools.calibration_table import Judgement, calibration_table, worth
from tools.conditional_logit import Choice, Logit, fit

JUDGED = [
    Judgement("crop_a_100", 0.95, True),
    Judgement("crop_a_015", 0.75, False),
    Judgement("crop_b_015", 0.65, True),
    Judgement("negs_a_1", 0.55, False),
]


def test_the_table_counts_what_would_be_accepted():
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in worth(JUDGED).splitlines()[2:]]
    assert rows[0] == ["0.5", "1/1", "1/2", "1", "1 of 1"]
    assert rows[2] == ["0.7", "1/1", "0/2", "1", "0 of 1"]


def test_confidences_are_held_against_what_came_true():
    assert "0.50 to 1.00 | 4     |       0.725 |        0.500" in calibration_table(JUDGED, (0.0, 0.5, 1.0))


def test_the_likeliest_candidate_is_judged():
    choice = Choice("crop_a_100", np.array([[0.0], [2.0]]), np.array([False, True]))
    judged = Judgement.of(choice, Logit(0.0, np.array([1.0])))
    assert judged.right
    assert judged.confidence > 0.6
    assert (
        Judgement.of(Choice("x", np.empty((0, 1)), np.empty(0, np.bool_)), Logit(0.0, np.array([1.0]))).confidence
        == 0.0
    )


def test_a_pair_that_weighs_more_moves_the_fit_more():
    good = Choice("good", np.array([[1.0], [0.0]]), np.array([True, False]))
    bad = Choice("bad", np.array([[1.0], [0.0]]), np.array([False, False]))
    heavy = Choice("good", good.features, good.right, weight=5.0)
    light = fit([good, bad], [0], 0.001).probabilities(good.features)[0]
    assert fit([heavy, bad], [0], 0.001).probabilities(good.features)[0] > light


def test_a_fit_learns_from_what_lies_near_the_truth():
    turned = Choice("a", np.array([[1.0], [0.0]]), np.array([False, False]), near=np.array([True, False]))
    plain = Choice("a", turned.features, turned.right)
    assert fit([turned], [0], 0.001).probabilities(turned.features)[0] > 0.9
    assert fit([plain], [0], 0.001).probabilities(turned.features)[0] < 0.1
    assert not Judgement.of(turned, Logit(0.0, np.array([2.0]))).right
