import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merging.config.registration import StructureConfig, VerificationConfig
from merging.fusion import warp
from merging.verification import Pieces, count_pieces, examine, seen_through_m, stretches_m, support_m
from merging.walls import Components, WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.grids.walls import (
    AGREED,
    AGREES,
    COMPARED,
    CONFLICTING,
    CONFLICTS,
    FACING,
    NOT_SEEN,
    OUTSIDE,
    UNSEEN,
    classify_walls,
    compare_walls,
)

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
    sums = compare_walls(
        source.walls, np.arange(len(source.points)), target.walls, np.array([motion]), CONFIG.limits()
    )[0]
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


LIMITS = VerificationConfig().limits()


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


def test_blocks_of_another_floor_conflict(rooms):
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
    held = classify_walls(source.walls, some, target.walls, motion, LIMITS)
    sums = compare_walls(source.walls, some, target.walls, np.array([motion]), LIMITS)[0]
    weights = source.weights
    assert weights[held == AGREES].sum() == pytest.approx(sums[AGREED])
    assert weights[held == CONFLICTS].sum() == pytest.approx(sums[CONFLICTING])
    assert weights[held == NOT_SEEN].sum() == pytest.approx(sums[UNSEEN])
    assert weights[(held != OUTSIDE) & (held != NOT_SEEN)].sum() == pytest.approx(sums[COMPARED])


REACH_M = VerificationConfig().see_through_m


def hall(*things):
    """A hall of 10 x 10 m with things in it, given as windows of cells."""
    masses = np.zeros((240, 240, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[18:222, 18:222] = (0.0, 0.0, 1.0, 0.0)
    masses[20:220, 20:220] = (0.0, 1.0, 0.0, 0.0)
    for thing in things:
        masses[thing] = (0.0, 0.0, 1.0, 0.0)
    return WallMap.from_grid(TbmGrid(GridGeometry(0.05, 0.0, 0.0, 240, 240), masses), StructureConfig())


def test_a_wall_across_a_free_room_counts_but_for_a_door():
    across = hall(np.s_[119:121, 60:180])
    assert seen_through_m(hall(), across, SE2.identity(), REACH_M) == pytest.approx((6.0 - 0.8) / 2.0, abs=0.2)
    assert seen_through_m(across, hall(), SE2.identity(), REACH_M) == pytest.approx((6.0 - 0.8) / 2.0, abs=0.2)


def test_things_and_doors_do_not():
    furnished = hall(np.s_[60:74, 60:74], np.s_[100:102, 80:98], np.s_[160:176, 100:102])
    assert seen_through_m(hall(), furnished, SE2.identity(), REACH_M) == 0.0
    assert seen_through_m(hall(), hall(), SE2.identity(), REACH_M) == 0.0


def test_a_wall_that_bent_away_does_not_and_what_stands_beside_it_hides_nothing():
    across, bent = hall(np.s_[119:121, 60:180]), hall(np.s_[127:129, 60:180])
    assert seen_through_m(across, bent, SE2.identity(), REACH_M) == 0.0
    crossed = hall(*(np.s_[col - 20 : col + 20, col : col + 2] for col in (100, 140)))  # stand upright, seen end on
    assert seen_through_m(crossed, across, SE2.identity(), REACH_M) > 0.0


def test_it_is_as_long_in_any_direction():
    aslant = hall(*(np.s_[row, row - 1 : row + 2] for row in range(60, 160)))
    assert seen_through_m(hall(), aslant, SE2.identity(), REACH_M) == pytest.approx((5.0 * 2**0.5 - 0.8) / 2.0, abs=0.2)


def test_maps_apart_do_not_contradict():
    assert seen_through_m(hall(), hall(), SE2(500.0, 0.0, 0.0), REACH_M) == 0.0


def slow_stretches_m(cells, resolution):
    """The same in an image of all cells."""
    image = np.zeros(np.ptp(cells, axis=0) + 3, np.uint8)
    image[tuple((cells - cells.min(axis=0) + 1).T)] = 1
    pieces = Components.of(cv2.dilate(image, np.ones((3, 3), np.uint8)) > 0)
    longest = np.hypot(*pieces.sides) * resolution
    longest[0] = 0.0
    longer = [max(cv2.minAreaRect(pieces.cells_of(index))[1]) for index in np.flatnonzero(longest > 0.8)]
    return sum(max(float(side) * resolution - resolution - 0.8, 0.0) for side in longer)


@given(seed=st.integers(0, 10_000), walls=st.integers(1, 30), resolution=st.sampled_from([0.03, 0.05, 0.1]))
def test_stretches_are_those_of_an_image_to_the_last_bit(seed, walls, resolution):
    rng = np.random.default_rng(seed)
    begins, ends = rng.integers(0, 200, size=(2, walls, 2))
    shares = np.linspace(0.0, rng.uniform(0.1, 1.0), 40)[:, None, None]
    cells = np.rint(begins + shares * (ends - begins)).astype(np.int64).reshape(-1, 2)
    assert stretches_m(cells, resolution) == slow_stretches_m(cells, resolution)
