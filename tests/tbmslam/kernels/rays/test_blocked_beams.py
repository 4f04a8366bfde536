import numpy as np

from tbmslam.kernels.rays.blocked_beams import follow_beams

LIMITS = (0.02, 1.0, 2.0, 1.0, 0.35, 0.7, 0.35)


def followed(rows, way=1.0, turn=0.5):
    """Return what is found after rows of ranges, each a way and a turn after the one before."""
    state = np.zeros((6, len(rows[0])))
    state[0] = np.nan
    for k, ranges in enumerate(rows):
        found = follow_beams(state, np.array(ranges), (float(k), way * k, turn * k, way, 100.0 + k), LIMITS, 3)
        assert found[2:] == (found[0].any(), found[1].any())
    return state, *found[:2]


def test_constant_near_beams_are_blocked_and_others_are_not():
    rows = [[0.3, 0.31, 0.3, 3.0, 0.8, 0.8, 0.81, 0.5 + 0.1 * k, np.nan, np.inf] for k in range(4)]
    state, blocked, suspected = followed(rows)
    assert np.flatnonzero(blocked).tolist() == [0, 1, 2, 4, 5, 6]
    assert np.flatnonzero(suspected).tolist() == [0, 1, 2]
    assert (state[1, 7], state[5, 7]) == (3.0, 103.0)
    assert (state[1, 0], state[5, 0]) == (0.0, 100.0)


def test_few_neighbours_are_not_blocked():
    rows = [[0.8, 0.8, 3.0, 0.8, 0.8, 0.8]] * 4
    assert np.flatnonzero(followed(rows)[1]).tolist() == [3, 4, 5]


def test_a_lost_range_proves_nothing():
    """The way on which it was lost counts not, neither against the others."""
    rows = [[0.8, 0.8, 0.8], [np.nan, np.inf, 0.8], [0.8, 0.8, 0.8]]
    state, blocked, _ = followed(rows)
    np.testing.assert_array_equal(state[2], [1.0, 1.0, 0.0])
    assert not blocked.any()
    assert followed([*rows, rows[0]])[1].all()


def test_turns_on_which_a_range_was_lost_do_not_count():
    rows = [[0.8] * 3] * 3 + [[np.nan] * 3] * 3
    assert not followed(rows, turn=0.45)[1].any()
    assert followed([*rows, [0.8] * 3], turn=0.45)[1].all()


def test_a_straight_way_blocks_nothing_but_raises_suspicion():
    _, blocked, suspected = followed([[0.3, 0.3, 0.3]] * 4, turn=0.0)
    assert not blocked.any()
    assert suspected.all()
