import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbmslam.kernels.search.connected_cells import boxes_of, components_of


def slow_pieces(cells, reach):
    """The same by asking every two cells, until no number falls any more."""
    labels = np.arange(len(cells))
    near = np.abs(cells[:, None] - cells[None]).max(axis=2) <= reach
    while True:
        lowest = np.array([labels[row].min() for row in near], dtype=np.int64)
        if np.array_equal(lowest, labels):
            return np.unique(labels, return_inverse=True)[1]
        labels = lowest


@given(st.sets(st.tuples(st.integers(0, 25), st.integers(0, 25)), max_size=60), st.integers(0, 4))
def test_cells_within_reach_of_each_other_are_one_piece(drawn, reach):
    cells = np.array(sorted(drawn), dtype=np.int64).reshape(-1, 2)
    assert components_of(cells, reach).tolist() == slow_pieces(cells, reach).tolist()


def test_a_snake_of_cells_is_one_piece():
    snake = [(row, col) for row in range(9) for col in range(12) if row % 2 == 0 or col == (0 if row % 4 == 1 else 11)]
    assert components_of(np.array(snake), 1).tolist() == [0] * len(snake)


def slow_box(rows, cols):
    if len(rows) == 0:
        return [0] * 5
    return [cols.min(), rows.min(), np.ptp(cols) + 1, np.ptp(rows) + 1, len(rows)]


@given(arrays(np.int32, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 4)))
def test_boxes_hold_the_cells_of_each_label(labels):
    expected = [slow_box(*np.nonzero(labels == label)) for label in range(6)]
    assert boxes_of(labels, 6).tolist() == expected
