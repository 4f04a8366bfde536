import math

import numpy as np
import pytest

from merging.candidates import refine_all
from merging.config import MergeConfig, StructureConfig
from merging.kriging import krige
from merging.structure import Structure
from merging.warping import warp
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.se2 import SE2
from tests.merging.bent_floor import bent_maps

CONFIG = MergeConfig()


def structure(grid):
    return Structure.from_grid(grid, StructureConfig())


def error(found, true, at=(0.0, 0.0)):
    (x, y), (u, v) = found.apply(np.array([at]))[0], true.apply(np.array([at]))[0]
    return math.hypot(x - u, y - v), abs(math.degrees(true.to(found).theta))


def with_kriging(**given):
    return CONFIG.model_copy(update={"kriging": CONFIG.kriging.model_copy(update=given)})


@pytest.mark.parametrize("offset", [SE2(0.05, -0.04, 0.0), SE2(0.0, 0.0, 0.008), SE2(-0.03, 0.04, -0.005)])
def test_what_is_not_bent_becomes_exact(rooms, offset):
    grid, true = rooms(1), SE2(2.0, 5.0, math.radians(40.0))
    target = structure(warp(grid, true, grid.geometry))
    metres, degrees = error(krige(target, structure(grid), true @ offset, CONFIG), true)
    assert metres < 0.02
    assert degrees < 0.05


def test_what_is_right_stays(rooms):
    grid = structure(rooms(1))
    metres, degrees = error(krige(grid, grid, SE2.identity(), CONFIG), SE2.identity())
    assert metres < 1e-6
    assert degrees < 1e-6


def test_nothing_near_leaves_the_alignment_alone(rooms):
    grid, blank = structure(rooms(1)), structure(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 9, 9)))
    assert krige(grid, blank, SE2(1.0, 2.0, 3.0), CONFIG) == SE2(1.0, 2.0, 3.0)
    assert krige(blank, grid, SE2(1.0, 2.0, 3.0), CONFIG) == SE2(1.0, 2.0, 3.0)
    assert krige(grid, grid, SE2(400.0, 0.0, 0.0), CONFIG) == SE2(400.0, 0.0, 0.0)


def test_without_iterations_the_alignment_stays(rooms):
    grid = structure(rooms(1))
    assert krige(grid, grid, SE2(0.05, 0.0, 0.0), with_kriging(iterations=0)) == SE2(0.05, 0.0, 0.0)


def test_who_is_the_target_does_not_matter():
    target, source, true = bent_maps("office", 0.06)
    one, other = structure(target.grid), structure(source.grid)
    forth = krige(one, other, true, CONFIG)
    back = krige(other, one, true.inverse(), CONFIG).inverse()
    # Patches are cut along the target's axes, so that the last millimetres differ.
    assert error(forth, back)[0] < 0.01
    assert error(forth, back)[1] < 0.05


def corridor(wall_m):
    """A corridor along x whose walls bear no feature."""
    masses = np.zeros((60, round(wall_m / 0.05), 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[10:50] = (0.0, 1.0, 0.0, 0.0)
    masses[[8, 9, 50, 51]] = (0.0, 0.0, 1.0, 0.0)
    return structure(TbmGrid(GridGeometry(0.05, 0.0, 0.0, *masses.shape[:2]), masses))


def test_along_a_bare_corridor_it_stays_where_it_is():
    found = krige(corridor(20.0), corridor(20.0), SE2(0.4, 0.05, 0.0), CONFIG)
    assert found.x == pytest.approx(0.4, abs=1e-3)
    assert found.y == pytest.approx(0.0, abs=0.005)


def test_a_room_full_of_walls_that_is_off_does_not_outweigh_a_bare_hall():
    """Shelves in one corner, all displaced by as much, are one reading of the bend there and not many of the motion."""
    hall = np.full((400, 400), 0, dtype=np.uint8)
    hall[10:390, 10:390] = 1
    hall[[8, 9, 390, 391], 8:392] = 2
    hall[8:392, [8, 9, 390, 391]] = 2
    here, there = hall.copy(), hall.copy()
    for row in range(20, 100, 8):
        here[row, 20:100], there[row + 1, 20:100] = 2, 2
    masses = np.array([(0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)], dtype=np.float32)
    geometry = GridGeometry(0.05, 0.0, 0.0, *hall.shape)
    target, source = (structure(TbmGrid(geometry, masses[one])) for one in (here, there))
    slid = refine_all(target, source, [SE2.identity()], CONFIG)[0]
    kriged = krige(target, source, slid, CONFIG)
    middle = (10.0, 10.0)
    assert error(kriged, SE2.identity(), middle)[0] < 0.5 * error(slid, SE2.identity(), middle)[0]


@pytest.mark.parametrize("most", [10, 60, 400])
def test_large_maps_are_cut_into_no_more_patches_than_can_be_solved(rooms, most):
    grid, true = rooms(1), SE2(2.0, 5.0, math.radians(40.0))
    target = structure(warp(grid, true, grid.geometry))
    found = krige(target, structure(grid), true @ SE2(0.03, 0.02, 0.0), with_kriging(most_patches=most))
    assert error(found, true)[0] < 0.03


def test_the_motion_is_that_of_generalised_least_squares(rooms):
    """One patch a wall and a bend that is noise to each: then the slow way, with the whole covariance, is plain."""
    grid = structure(rooms(1))
    start = SE2(0.02, -0.01, 0.001)
    alone = with_kriging(iterations=1, bend_m=1e-6, patch_noise_m=1e-6, patch_m=1e-3, most_patches=10**6)
    few = alone.model_copy(update={"refinement": CONFIG.refinement.model_copy(update={"many_walls": 150})})
    found = krige(grid, grid, start, few)
    rows, metres, weights = [], [], []
    some = grid.some(150)
    for moving_to_fixed, sign in ((start, 1.0), (start.inverse(), -1.0)):
        for k in some:
            point = moving_to_fixed.apply(grid.points[k : k + 1])[0]
            turned = SE2(0.0, 0.0, moving_to_fixed.theta).apply(grid.normals[k : k + 1])[0]
            row, col = math.floor(point[1] / 0.05), math.floor(point[0] / 0.05)
            if not (0 <= row < grid.geometry.rows and 0 <= col < grid.geometry.cols):
                continue
            near = grid.nearest[row, col]
            normal = grid.normals[near]
            cosine = float(turned @ normal)
            if grid.two_sided[k] or grid.two_sided[near]:
                cosine = abs(cosine)
            if grid.distances_m[row, col] > few.kriging.reach_m or cosine < 0.7:
                continue
            metre = float((point - grid.points[near]) @ normal)
            if sign < 0.0:
                point = start.apply(grid.points[k : k + 1])[0]
                normal = SE2(0.0, 0.0, start.theta).apply(normal[None])[0]
            rows.append((*point, *normal))
            metres.append(sign * metre)
            weights.append(grid.weights[k] / (1.0 + (metre / few.kriging.width_m) ** 2) ** 2)
    x, y, nx, ny = np.array(rows).T
    mx, my = x.mean(), y.mean()
    pulls = np.column_stack((nx, ny, (x - mx) * ny - (y - my) * nx))
    prior = np.diag([CONFIG.exactness.place_m**-2, CONFIG.exactness.place_m**-2, CONFIG.exactness.turn_rad**-2])
    precision = np.diag(np.array(weights) / few.kriging.cell_noise_m**2)
    step = np.linalg.solve(pulls.T @ precision @ pulls + prior, -(pulls.T @ precision @ np.array(metres)))
    there = SE2(mx, my, 0.0)
    slow = there @ SE2(*step) @ there.inverse() @ start
    assert error(found, slow)[0] < 1e-4
    assert error(found, slow)[1] < 1e-3
