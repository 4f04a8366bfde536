import itertools
import math

import pytest

from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.fusion import warp
from merging.registration.correlation import best_of, find_candidates, refine_all
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2

CONFIG = MergeConfig()


def structure(grid):
    return WallMap.from_grid(grid, StructureConfig())


def refine(target, source, motion, config):
    return refine_all(target, source, [motion], config)[0]


def error(found, true):
    vx, vy, omega = (true.inverse() @ found).log()
    return math.hypot(vx, vy), abs(math.degrees(omega))


@pytest.mark.parametrize("offset", [SE2(0.3, -0.2, 0.0), SE2(0.0, 0.0, 0.03), SE2(-0.15, 0.2, -0.02)])
def test_a_rough_guess_becomes_exact(rooms, offset):
    grid, true = rooms(1), SE2(2.0, 5.0, math.radians(40.0))
    target = structure(warp(grid, true, grid.geometry))
    metres, degrees = error(refine(target, structure(grid), true @ offset, CONFIG), true)
    assert metres < 0.02
    assert degrees < 0.05


def test_what_is_right_stays(rooms):
    grid = structure(rooms(1))
    metres, degrees = error(refine(grid, grid, SE2.identity(), CONFIG), SE2.identity())
    assert metres < 1e-6
    assert degrees < 1e-6


def test_nothing_near_leaves_the_guess_alone(rooms):
    grid, blank = structure(rooms(1)), structure(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 9, 9)))
    guess = SE2(1.0, 2.0, 3.0)
    assert refine(grid, blank, guess, CONFIG) == pytest.approx(guess)
    assert refine(grid, grid, SE2(400.0, 0.0, 0.0), CONFIG) == pytest.approx((400.0, 0.0, 0.0))


def test_nothing_speaks_for_any_place_where_a_map_has_no_walls(rooms):
    grid, blank = structure(rooms(1)), structure(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 9, 9)))
    for target, source in ((grid, blank), (blank, grid), (blank, blank)):
        assert best_of([SE2.identity()], target, source, CONFIG) == []


def test_the_true_place_comes_first_and_every_other_is_elsewhere(rooms):
    grid, true = rooms(1), SE2(2.0, 5.0, math.radians(40.0))
    source = structure(grid)
    candidates = find_candidates(structure(warp(grid, true, grid.geometry)), source, CONFIG)
    metres, degrees = error(candidates[0][0], true)
    assert metres < 0.02
    assert degrees < 0.05
    assert 1 < len(candidates) <= CONFIG.correlation.finalists
    centre = source.points.mean(axis=0)
    for (first, _), (second, _) in itertools.combinations(candidates, 2):
        turn = abs((first.inverse() @ second).theta)
        assert math.dist(first.apply(centre), second.apply(centre)) > 1.0 or turn > 0.15


def test_few_turns_are_enough_where_many_walls_tell_which(rooms):
    grid, true = rooms(1), SE2(2.0, 5.0, math.radians(40.0))
    few = MergeConfig(correlation=CONFIG.correlation.model_copy(update={"most_turns": 40}))
    candidates = find_candidates(structure(warp(grid, true, grid.geometry)), structure(grid), few)
    metres, degrees = error(candidates[0][0], true)
    assert metres < 0.02
    assert degrees < 0.05
