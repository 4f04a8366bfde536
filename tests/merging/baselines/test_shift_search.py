import numpy as np

from merging.baselines.shift_search import ShiftSearch


def test_the_true_shift_scores_best():
    rng = np.random.default_rng(1)
    points = rng.uniform(-5, 5, 60) + 1j * rng.uniform(-5, 5, 60)
    search = ShiftSearch.over([(points + (2.0 - 3.0j), np.ones(60))], 12.0, 0.2)
    scores, shifts = search.best([(points, np.ones(60))], 3)
    assert abs(shifts[0] - (2.0 - 3.0j)) <= 0.3
    assert scores[0] > 2.0 * scores[1]


def test_points_of_another_channel_do_not_count():
    here, nothing = (np.array([0.1 + 0.1j]), np.ones(1)), (np.empty(0, dtype=complex), np.empty(0))
    search = ShiftSearch.over([here, nothing], 4.0, 0.2)
    assert search.best([nothing, here], 1)[0][0] < 1e-6 < search.best([here, nothing], 1)[0][0]
