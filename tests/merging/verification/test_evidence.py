import math

import numpy as np
import pytest

from merging.config.registration import StructureConfig, VerificationConfig
from merging.fusion import warp
from merging.verification import examine, support_m
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.grids.walls import FACING
from tbmslam.map.walls import compare

CONFIG = VerificationConfig()


def structure(grid):
    return WallMap.from_grid(grid, StructureConfig())


def corridor(length=200):
    """Two long walls and nothing else, 2 m apart."""
    masses = np.zeros((60, length, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[10:50] = (0.0, 1.0, 0.0, 0.0)
    masses[8:10] = masses[50:52] = (0.0, 0.0, 1.0, 0.0)
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, 60, length), masses)


def test_a_map_agrees_with_itself(rooms):
    grid = rooms(1)
    evidence = examine(structure(grid), structure(grid), SE2.identity(), CONFIG)
    assert evidence.agreement == 1.0
    assert evidence.conflict == 0.0
    assert evidence.overlap_m2 == pytest.approx(240 * 320 * 0.05**2)
    assert evidence.weakest_wall_m > 10.0
    assert evidence.rmse_m == 0.0


def test_it_agrees_with_itself_turned(rooms):
    grid, motion = rooms(1), SE2(3.0, -4.0, math.radians(33.0))
    evidence = examine(structure(warp(grid, motion, grid.geometry)), structure(grid), motion, CONFIG)
    assert evidence.agreement > 0.9
    assert 0.0 < evidence.rmse_m < 0.05
    assert evidence.conflict < 0.01


def test_the_same_either_way_round(rooms):
    first, second = structure(rooms(1)), structure(rooms(2))
    motion = SE2(1.0, -2.0, 0.4)
    forth, back = examine(first, second, motion, CONFIG), examine(second, first, motion.inverse(), CONFIG)
    assert forth.agreement == pytest.approx(back.agreement)
    assert forth.conflict == pytest.approx(back.conflict)
    assert forth.overlap_m2 == pytest.approx(back.overlap_m2, rel=0.01)


def test_another_floor_conflicts(rooms):
    evidence = examine(structure(rooms(1)), structure(rooms(2)), SE2.identity(), CONFIG)
    assert evidence.conflict > 0.2


def test_things_that_people_move_hardly_count(rooms):
    """A box on the other map's free space contradicts, and says little of where the walls are."""
    plain = rooms(1)
    masses = plain.masses.copy()
    masses[100:108, 120:128] = (0.0, 0.0, 1.0, 0.0)
    boxed = TbmGrid(plain.geometry, masses)
    evidence = examine(structure(plain), structure(boxed), SE2.identity(), CONFIG)
    assert evidence.conflicting_wall_m > 0.0
    assert evidence.agreed_wall_m > 0.98 * evidence.compared_wall_m > 10.0
    other = examine(structure(rooms(1)), structure(rooms(2)), SE2.identity(), CONFIG)
    assert other.agreed_wall_m < 0.5 * other.compared_wall_m


def test_a_wall_seen_from_the_other_side_does_not_agree():
    left = corridor()
    beyond = SE2(0.0, -42 * 0.05, 0.0)  # the other corridor's far wall on this one's near wall, back to back
    evidence = examine(structure(left), structure(left), beyond, CONFIG)
    assert evidence.agreement == 0.0


def test_a_bare_corridor_could_slide():
    evidence = examine(structure(corridor()), structure(corridor()), SE2(3.0, 0.0, 0.0), CONFIG)
    assert evidence.agreement > 0.99
    assert evidence.weakest_wall_m < 0.1


def test_maps_apart_have_nothing_in_common(rooms):
    evidence = examine(structure(rooms(1)), structure(rooms(1)), SE2(500.0, 0.0, 0.0), CONFIG)
    assert (evidence.overlap_m2, evidence.agreement, evidence.conflict) == (0.0, 0.0, 0.0)


def test_a_wall_that_a_robot_must_have_seen_and_did_not_is_counted():
    """Beyond the corridor's end nothing is known, but a wall across it was there to be seen."""
    closed, open_end = corridor(), corridor()
    closed.masses[10:50, 196:200] = (0.0, 0.0, 1.0, 0.0)
    open_end.masses[:, 196:] = (0.0, 0.0, 0.0, 1.0)
    evidence = examine(structure(open_end), structure(closed), SE2.identity(), CONFIG)
    assert evidence.unseen_wall_m == pytest.approx(40 * 0.05 / 2, abs=0.3)  # in one of the two directions
    assert evidence.conflicting_wall_m == 0.0


def test_sums_are_those_of_the_slow_twin(rooms):
    """The kernel against the plain definition, with every wall by itself."""
    target, source, motion = structure(rooms(1)), structure(rooms(2)), SE2(1.0, -2.0, 0.4)
    sums = compare(source.walls, np.arange(len(source.points)), target.walls, [motion], CONFIG.limits())[0]
    expected = np.zeros(8)
    turn = SE2(0.0, 0.0, motion.theta)
    for point, normal, both, weight in zip(
        motion.apply(source.points), turn.apply(source.normals), source.two_sided, source.weights, strict=True
    ):
        (row,), (col,), (inside,) = target.geometry.cells_at(point[None])
        if not inside:
            continue
        distance, nearest = float(target.distances_m[row, col]), target.nearest[row, col]
        cosine = float(normal @ target.normals[nearest])
        cosine = abs(cosine) if both or target.two_sided[nearest] else cosine
        if distance <= 0.15 and cosine >= FACING:
            xx, xy, yy = normal[0] ** 2, normal[0] * normal[1], normal[1] ** 2
            expected += weight * np.array([1.0, 1.0, 0.0, 0.0, xx, xy, yy, distance**2])
        elif target.known[row, col]:
            expected[0] += weight
            expected[2] += weight * bool(target.free[row, col] and distance > 0.3)
        elif distance > 0.15:
            (row,), (col,), (inside,) = target.geometry.cells_at((point + 0.3 * normal)[None])
            expected[3] += weight * bool(inside and target.free[row, col])
    np.testing.assert_allclose(sums, expected, rtol=1e-5)


def test_support_weighs_what_speaks_against(rooms):
    target, source = structure(rooms(1)), structure(rooms(1))
    here, elsewhere = support_m(target, source, [SE2.identity(), SE2(3.0, 1.0, 0.5)], CONFIG)
    assert here == pytest.approx(float(target.weights.sum()) * target.geometry.resolution)  # all agrees with itself
    assert elsewhere < 0.0 < here


def furnished(*things):
    """A long corridor with things of 0.5 x 0.5 m in it, at columns of cells."""
    grid = corridor()
    for col in things:
        grid.masses[25:35, col : col + 10] = (0.0, 0.0, 1.0, 0.0)
    return structure(grid)


def test_things_are_told_apart_from_walls():
    same, moved, none = (
        examine(furnished(40, 120), furnished(*things), SE2.identity(), CONFIG) for things in ((40, 120), (40, 160), ())
    )
    assert same.agreed_things_m == same.compared_things_m == pytest.approx(2 * 4 * 0.5, rel=0.15)
    assert moved.compared_things_m == pytest.approx(same.compared_things_m)
    assert moved.agreed_things_m == pytest.approx(same.agreed_things_m / 2.0)
    assert none.agreed_things_m == 0.0
    assert same.agreed_wall_m == pytest.approx(moved.agreed_wall_m, rel=0.05)


def test_conflict_and_agreement_are_shares_of_what_is_compared(rooms):
    target, source = structure(rooms(1)), structure(rooms(2))
    evidence = examine(target, source, SE2(0.5, 0.3, 0.4), CONFIG)
    assert evidence.conflicting_wall_m > 1.0
    assert evidence.compared_wall_m > evidence.conflicting_wall_m + evidence.agreed_wall_m - 1e-9
    assert evidence.conflict == pytest.approx(evidence.conflicting_wall_m / evidence.compared_wall_m)
    assert evidence.agreement == pytest.approx(evidence.agreed_wall_m / evidence.compared_wall_m)
