import numpy as np

from tools.conditional_logit import Choice, fit

FIRST = np.array([True, False])
NONE = np.array([False, False])
NUMBERS = np.array([[1.0], [0.0]])


def test_a_pair_that_weighs_more_moves_the_fit_more():
    good, bad = Choice("good", NUMBERS, FIRST), Choice("bad", NUMBERS, NONE)
    heavy = Choice("good", NUMBERS, FIRST, weight=5.0)
    light = fit([good, bad], [0], 0.001).probabilities(NUMBERS)[0]
    assert fit([heavy, bad], [0], 0.001).probabilities(NUMBERS)[0] > light


def test_a_fit_learns_from_what_lies_near_the_truth():
    turned, plain = Choice("a", NUMBERS, NONE, near=FIRST), Choice("a", NUMBERS, NONE)
    assert fit([turned], [0], 0.001).probabilities(NUMBERS)[0] > 0.9
    assert fit([plain], [0], 0.001).probabilities(NUMBERS)[0] < 0.1


def test_where_one_of_them_is_right_only_differences_tell():
    """A number that all candidates of a choice share says nothing of which is right."""
    rng = np.random.default_rng(1)
    shared, own = rng.normal(size=(40, 1)), rng.normal(size=(40, 2))
    choices = [
        Choice(str(i), np.column_stack((np.repeat(common, 2), mine)), mine == mine.max())
        for i, (common, mine) in enumerate(zip(shared, own, strict=True))
    ]
    found = fit(choices, [0, 0], 0.001, none=False)
    assert found.bias == 0.0
    assert abs(found.weights[0]) < 1e-3
    assert found.weights[1] > 1.0
    assert fit(choices, [0, -1], 0.001, none=False).weights[1] == 0.0
