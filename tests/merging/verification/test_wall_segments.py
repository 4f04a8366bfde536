import math

import numpy as np
import pytest

from merging.config.registration import StructureConfig, VerificationConfig
from merging.fusion import warp
from merging.verification import Pieces, count_pieces
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.walls import AGREED, AGREES, COMPARED, CONFLICTING, CONFLICTS, NOT_SEEN, OUTSIDE, UNSEEN, compare, hold

LIMITS = VerificationConfig().limits()


def structure(grid):
    return WallMap.from_grid(grid, StructureConfig())


def straight(length=400):
    """One long wall with free space on one side."""
    masses = np.zeros((60, length, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[10:50] = (0.0, 1.0, 0.0, 0.0)
    masses[8:10] = (0.0, 0.0, 1.0, 0.0)
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, 60, length), masses)


def test_a_map_agrees_with_itself_piece_by_piece(rooms):
    one = structure(rooms(1))
    pieces = count_pieces(one, one, SE2.identity(), LIMITS)
    assert pieces.agreeing >= 0.95 * pieces.compared > 30.0
    assert pieces.conflicting == 0.0
    assert pieces.corners > 10.0


def test_a_straight_wall_has_no_corners():
    wall = structure(straight())
    pieces = count_pieces(wall, wall, SE2.identity(), LIMITS)
    assert pieces.agreeing == pytest.approx(20.0, abs=1.0)
    assert pieces.corners < 0.1


def test_a_box_that_may_be_moved_hardly_counts():
    grid = straight()
    grid.masses[30:38, 100:108] = (0.0, 0.0, 1.0, 0.0)
    boxed = structure(grid)
    pieces = count_pieces(boxed, boxed, SE2.identity(), LIMITS)
    assert pieces.agreeing == pytest.approx(20.0, abs=1.0)
    assert pieces.corners < 0.5


def test_another_floor_conflicts(rooms):
    first, second = structure(rooms(1)), structure(rooms(2))
    pieces = count_pieces(first, second, SE2(1.0, 0.5, 0.3), LIMITS)
    assert pieces.conflicting > pieces.agreeing


def test_about_the_same_in_any_frame_and_either_way_round(rooms):
    grid, motion = rooms(1), SE2(3.0, -4.0, math.radians(33.0))
    turned, still = structure(warp(grid, motion, grid.geometry)), structure(grid)
    forth, back = (count_pieces(turned, still, motion, LIMITS), count_pieces(still, turned, motion.inverse(), LIMITS))
    assert forth.agreeing == pytest.approx(back.agreeing, rel=0.15)
    assert forth.corners == pytest.approx(back.corners, rel=0.25)


def test_maps_apart_have_no_pieces_in_common(rooms):
    one = structure(rooms(1))
    assert count_pieces(one, one, SE2(500.0, 0.0, 0.0), LIMITS) == Pieces(0.0, 0.0, 0.0, 0.0)


def test_each_wall_is_told_as_the_sums_count_it(rooms):
    target, source, motion = structure(rooms(1)), structure(rooms(2)), SE2(1.0, -2.0, 0.4)
    some = np.arange(len(source.points))
    held = hold(source.walls, some, target.walls, motion, LIMITS)
    sums = compare(source.walls, some, target.walls, [motion], LIMITS)[0]
    weights = source.weights
    assert weights[held == AGREES].sum() == pytest.approx(sums[AGREED])
    assert weights[held == CONFLICTS].sum() == pytest.approx(sums[CONFLICTING])
    assert weights[held == NOT_SEEN].sum() == pytest.approx(sums[UNSEEN])
    assert weights[(held != OUTSIDE) & (held != NOT_SEEN)].sum() == pytest.approx(sums[COMPARED])
