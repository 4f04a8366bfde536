import numpy as np

from merging.walls.components import Components


def test_cells_that_touch_are_a_piece():
    cells = np.zeros((6, 8), dtype=bool)
    cells[1, 1:4] = cells[2, 4] = cells[5, 7] = True  # the second touches the first at a corner
    pieces = Components.of(cells)
    assert pieces.labels.shape == cells.shape
    assert set(pieces.labels[~cells]) == {0}
    long, short = pieces.labels[1, 1], pieces.labels[5, 7]
    assert pieces.labels[2, 4] == long != short
    assert [side[long] for side in pieces.sides] == [4, 2]
    assert sorted(pieces.cells_of(long).tolist()) == [[0, 0], [1, 0], [2, 0], [3, 1]]
    assert pieces.cells_of(short).tolist() == [[0, 0]]


def test_short_pieces_may_be_dropped():
    cells = np.zeros((6, 9), dtype=bool)
    cells[0, 0] = cells[2, 1:5] = cells[4:, 7] = True
    pieces = Components.of(cells).at_least(2)
    assert set(pieces.labels[2, 1:5]) | set(pieces.labels[4:, 7]) == {1, 2}
    assert pieces.labels[0, 0] == 0
    assert len(pieces.stats) == 3
    assert pieces.stats[pieces.labels[2, 1], 4] == 4


def test_there_may_be_no_piece():
    pieces = Components.of(np.zeros((3, 4), dtype=bool))
    assert len(pieces.stats) == 1
