import math

import pytest

from merging.config import RefinementConfig, StructureConfig
from merging.refinement import refine
from merging.structure import Structure
from merging.warping import warp
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.se2 import SE2

CONFIG = RefinementConfig()


def structure(grid):
    return Structure.from_grid(grid, StructureConfig())


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
    assert refine(grid, blank, guess, CONFIG) == guess
    assert refine(grid, grid, SE2(400.0, 0.0, 0.0), CONFIG) == SE2(400.0, 0.0, 0.0)
