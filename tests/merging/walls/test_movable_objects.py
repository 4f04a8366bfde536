import cv2
import numpy as np
import pytest

from merging.config.registration import StructureConfig
from merging.walls import Components, steadiness


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


CELL = 0.05
CONFIG = StructureConfig(
    movable_m=0.8, steady_m=1.2, least_weight=0.1, gap_m=0.1, block_m=0.25, thing_m=1.8, hollow_m=0.45
)


def weights_of(walls, free=None):
    """The weights (rows, cols) of all walls; what is no wall is free."""
    weights = np.full(walls.shape, np.nan)
    weights[walls] = steadiness(walls, ~walls if free is None else free, walls, CELL, CONFIG)
    return weights


def box(side_m, degrees, *, solid):
    """A square thing that stands turned by so much in the middle of a floor."""
    corners = cv2.boxPoints(((60.0, 60.0), (side_m / CELL, side_m / CELL), degrees)).round().astype(np.int32)
    image = np.zeros((120, 120), np.uint8)
    if solid:
        cv2.fillPoly(image, [corners], 1)
    else:
        cv2.polylines(image, [corners], isClosed=True, color=1)
    return image > 0


@pytest.mark.parametrize("solid", [True, False])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0])
def test_small_things_weigh_little_however_they_are_turned(degrees, solid):
    walls = box(0.7, degrees, solid=solid)
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)


@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_large_things_weigh_whole(degrees):
    walls = box(2.2, degrees, solid=False)
    np.testing.assert_allclose(weights_of(walls)[walls], 1.0)


def test_weights_rise_with_length():
    walls = np.zeros((60, 60), np.bool_)
    lengths_m = np.array([0.5, 0.9, 1.0, 1.1, 1.5])
    for row, length_m in zip(range(5, 60, 10), lengths_m, strict=False):
        walls[row, 10 : 10 + round(length_m / CELL)] = True
    found = [float(weights_of(walls)[row, 10]) for row in range(5, 55, 10)]
    np.testing.assert_allclose(found, [0.1, 0.25, 0.5, 0.75, 1.0])


def test_a_block_against_a_wall_weighs_little_and_the_wall_whole():
    walls = np.zeros((60, 80), np.bool_)
    walls[10:12] = True
    walls[12:22, 30:42] = True
    weights = weights_of(walls)
    np.testing.assert_allclose(weights[14:22, 30:42], 0.1)
    np.testing.assert_allclose(weights[10:12, :28], 1.0)
    np.testing.assert_allclose(weights[10:12, 44:], 1.0)


def test_a_thick_wall_is_no_block():
    walls = np.zeros((60, 80), np.bool_)
    walls[10:20, 5:75] = True
    np.testing.assert_allclose(weights_of(walls)[walls], 1.0)


def test_no_walls_have_no_weights():
    none = np.zeros((5, 5), np.bool_)
    assert len(steadiness(none, none, none, CELL, CONFIG)) == 0


def test_gaps_do_not_part_a_wall():
    walls = np.zeros((40, 80), np.bool_)
    walls[20, 10:70] = True
    walls[20, 16:70:8] = walls[20, 17:70:8] = False  # pieces of 0.3 m, 0.1 m apart
    np.testing.assert_allclose(weights_of(walls)[walls], 1.0)
    walls[20, 18:70:8] = walls[20, 19:70:8] = False  # now 0.2 m apart
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_an_outline_against_a_wall_weighs_little_and_the_wall_whole(degrees):
    walls = box(1.2, degrees, solid=False)
    walls[47:49] = True  # through its lower part
    weights = weights_of(walls)
    np.testing.assert_allclose(weights[55:][walls[55:]], 0.1)
    np.testing.assert_allclose(weights[47:49, :35], 1.0)


def test_outlines_that_touch_weigh_little():
    walls = np.zeros((60, 100), np.bool_)
    for left in (20, 40, 60):
        walls[[20, 40], left : left + 21] = True
        walls[20:41, [left, left + 20]] = True
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)


def test_two_faces_of_a_short_wall_are_no_thing():
    """Of a wall 0.3 m thick between two doors both faces were seen, and nothing between them."""
    walls = np.zeros((60, 60), np.bool_)
    walls[20:27, 14:46] = True
    free = ~walls
    walls[21:26, 15:45] = False
    np.testing.assert_allclose(weights_of(walls, free)[walls], 1.0)
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)  # a low cupboard whose inside was seen


def test_a_room_is_no_thing():
    np.testing.assert_allclose(weights_of(box(2.0, 0.0, solid=False))[box(2.0, 0.0, solid=False)], 1.0)
