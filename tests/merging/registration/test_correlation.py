import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from merging import MergeConfig, align
from merging.config.registration import CorrelationConfig, StructureConfig, VerificationConfig
from merging.fusion import warp
from merging.registration import correlation
from merging.registration.correlation import _cell_size, _directions, _Layout, _Search, distinct, propose, same_place
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap

CONFIG = CorrelationConfig()


def structure(grid):
    return WallMap.from_grid(grid, StructureConfig())


def left_part(grid, share):
    part = TbmGrid(grid.geometry, grid.masses.copy())
    part.masses[:, round(share * grid.geometry.cols) :] = (0.0, 0.0, 0.0, 1.0)
    return part


def error_of(found, true, grid):
    centre = grid.geometry.centre_of(grid.geometry.rows // 2, grid.geometry.cols // 2)
    turn = (true.inverse() @ found).log()[2]
    return np.linalg.norm(found.apply(centre) - true.apply(centre)), abs(math.degrees(turn))


@pytest.mark.parametrize("motion", [SE2(0.0, 0.0, 0.0), SE2(-31.0, 8.0, math.radians(143.0)), SE2(7.7, 2.1, -2.2)])
def test_the_true_motion_is_proposed_first(rooms, motion):
    source = left_part(rooms(3), 0.6)
    best = propose(structure(warp(rooms(3), motion, rooms(3).geometry)), structure(source), CONFIG).motions[0]
    metres, degrees = error_of(best, motion, source)
    assert metres < 0.4
    assert degrees < 3.0


def test_a_turn_is_found_that_the_ways_of_most_walls_speak_against(rooms):
    """Most walls of the source run askew, on a side that the target does not show."""
    target, source = left_part(rooms(3), 0.5), rooms(3)
    rows, cols = np.mgrid[0 : source.geometry.rows, 0 : source.geometry.cols]
    askew = ((cols + 0.4 * rows) % 12 < 2) & (cols > 170)
    source.masses[askew] = (0.0, 0.0, 1.0, 0.0)
    metres, degrees = error_of(propose(structure(target), structure(source), CONFIG).motions[0], SE2.identity(), target)
    assert metres < 0.4
    assert degrees < 3.0
    blind = CONFIG.model_copy(update={"turns_share": 0.02})
    assert all(
        abs(math.degrees(one.theta)) > 3.0 for one in propose(structure(target), structure(source), blind).motions
    )


def floor_plan(motion):
    """Walls of one cell in free space."""
    geometry, drawn = GridGeometry(0.05, -10.0, -10.0, 400, 400), np.zeros((400, 400), dtype=np.uint8)
    for ends in (
        *([(-5, -4), (5, -4)], [(5, -4), (5, 4)], [(5, 4), (-5, 4)], [(-5, 4), (-5, -4)]),
        *([(-5, 0), (1, 0)], [(-2, 0), (-2, 4)], [(2, 1), (5, 1)], [(3, -4), (3, -2)]),
    ):
        first, last = np.rint((motion.apply(np.array(ends, dtype=float)) + 10.0) / 0.05).astype(int).tolist()
        cv2.line(drawn, first, last, 1)
    walls = drawn[..., None] == 1
    return structure(TbmGrid(geometry, np.where(walls, (0.0, 0.0, 1.0, 0.0), (0.0, 1.0, 0.0, 0.0)).astype(np.float32)))


@pytest.mark.parametrize("degrees", [-60.0, 200.0])
def test_a_turn_is_found_by_walls_with_two_sides(degrees):
    motion, few_turns = SE2(0.5, -0.3, math.radians(degrees)), CONFIG.model_copy(update={"turns_share": 0.2})
    target, source = floor_plan(motion), floor_plan(SE2.identity())
    assert target.two_sided.mean() > 0.97
    difference = motion.to(propose(target, source, few_turns).motions[0])
    assert math.hypot(difference.x, difference.y) < 0.2
    assert abs(math.degrees(difference.theta)) < 1.5


def test_no_two_proposals_are_alike(rooms):
    proposals = propose(structure(rooms(1)), structure(rooms(1)), CONFIG).motions
    assert 100 < len(proposals) <= CONFIG.proposals
    assert len(set(proposals)) == len(proposals)


def test_a_map_without_walls_proposes_nothing(rooms):
    blank = structure(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20)))
    assert propose(blank, structure(rooms(1)), CONFIG).motions == []
    assert propose(structure(rooms(1)), blank, CONFIG).motions == []
    alignment = align(TbmMap(rooms(1)), TbmMap(grid_with_one_free_cell()), MergeConfig(method="correlation"))
    assert not alignment.accepted
    assert alignment.reason == "the source map holds no wall: their relative pose is unknown"


def grid_with_one_free_cell():
    grid = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20))
    grid.masses[3, 4] = (0.0, 1.0, 0.0, 0.0)
    return grid


def test_maps_of_other_cell_sizes_are_found(rooms):
    motion = SE2(1.3, 2.2, 0.7)
    coarse = warp(rooms(4), motion, rooms(4).geometry._replace(resolution=0.1))
    alignment = align(TbmMap(coarse), TbmMap(left_part(rooms(4), 0.7)), MergeConfig(method="correlation"))
    assert alignment.accepted, alignment.reason
    metres, degrees = error_of(alignment.T_target_source, motion, rooms(4))
    assert metres < 0.1
    assert degrees < 0.6


def test_who_is_named_first_does_not_matter(rooms):
    motion = SE2(7.7, 2.1, -2.2)
    part, whole = TbmMap(left_part(rooms(3), 0.6)), TbmMap(warp(rooms(3), motion, rooms(3).geometry))
    forth, back = align(whole, part), align(part, whole)
    assert forth.accepted
    assert back == forth.reversed()
    assert error_of(back.T_target_source, motion.inverse(), rooms(3))[0] < 0.1
    unlike, other = TbmMap(left_part(rooms(1), 0.5)), TbmMap(rooms(2))
    assert align(unlike, other) == align(other, unlike).reversed()


def test_a_real_map_is_found_in_its_turned_half(real_map):
    motion = SE2(12.0, -3.0, math.radians(-77.0))
    turned = warp(left_part(real_map.cropped_to_known(), 0.6), motion, real_map.geometry)
    alignment = align(TbmMap(turned), TbmMap(real_map), MergeConfig(method="correlation"))
    assert alignment.accepted, alignment.reason
    metres, degrees = error_of(alignment.T_target_source, motion, real_map)
    assert metres < 0.1
    assert degrees < 0.5


def test_another_building_is_refused(rooms):
    assert not align(TbmMap(rooms(1)), TbmMap(rooms(2)), MergeConfig(method="correlation")).accepted


def test_a_map_that_fits_mirrored_is_refused_and_told(rooms):
    part = left_part(rooms(3), 0.7)
    flipped = TbmMap(TbmGrid(part.geometry, np.ascontiguousarray(part.masses[:, ::-1])))
    for alignment in (align(TbmMap(rooms(3)), flipped), align(flipped, TbmMap(rooms(3)))):
        assert not alignment.accepted
        assert "; the mirror image of the source would fit with confidence " in alignment.reason
        assert alignment.reason.endswith("is one map's picture flipped, or was a laser mounted upside down?")
    assert "mirror" not in align(TbmMap(rooms(1)), TbmMap(rooms(2))).reason
    assert "mirror" not in align(TbmMap(rooms(3)), TbmMap(part)).reason


def test_a_small_overlap_is_not_blamed_on_the_mirror_image(rooms):
    config = MergeConfig(verification=VerificationConfig(min_overlap_m2=1000.0))
    alignment = align(TbmMap(rooms(3)), TbmMap(left_part(rooms(3), 0.7)), config)
    assert not alignment.accepted
    assert alignment.confidence > 0.99
    assert alignment.reason.endswith("is under 1000 m2")


def test_a_symmetric_place_is_refused_and_its_mirror_image_named():
    """A room with an alcove fits itself once, and so does its mirror image."""
    grid = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 240, 320))
    for rows, cols in ((slice(60, 182), slice(10, 222)), (slice(100, 142), slice(220, 302))):
        grid.masses[rows.start - 2 : rows.stop + 2, cols.start - 2 : cols.stop + 2] = (0.0, 0.0, 1.0, 0.0)
    for rows, cols in ((slice(60, 182), slice(10, 222)), (slice(100, 142), slice(220, 302))):
        grid.masses[rows, cols] = (0.0, 1.0, 0.0, 0.0)
    alignment = align(TbmMap(grid), TbmMap(grid), MergeConfig(method="correlation"))
    assert not alignment.accepted
    assert not alignment.ambiguous
    assert "; the mirror image of the source also fits (" in alignment.reason
    assert alignment.reason.endswith(" m agree, 100%): the place may be symmetric, or the fit may be by chance")


def test_a_room_that_looks_the_same_turned_is_ambiguous():
    """A rectangle fits itself twice; which way round cannot be known."""
    grid = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 140, 220))
    grid.masses[8:132, 8:212] = (0.0, 0.0, 1.0, 0.0)
    grid.masses[10:130, 10:210] = (0.0, 1.0, 0.0, 0.0)
    alignment = align(TbmMap(grid), TbmMap(grid), MergeConfig(method="correlation"))
    assert not alignment.accepted
    assert alignment.ambiguous
    assert alignment.reason.startswith("ambiguous: 2 places fit about as well, the best with confidence 0.")
    assert "mirror" not in alignment.reason
    turned = alignment.alternatives[0].T_target_source.theta - alignment.T_target_source.theta
    assert abs(math.remainder(turned - math.pi, 2.0 * math.pi)) < 0.01
    assert alignment.alternatives[0].confidence == pytest.approx(alignment.confidence, rel=0.3)


LIMITS = 1.0, 0.15


def is_near(one, other):
    turn = abs((one[2] - other[2] + math.pi) % (2.0 * math.pi) - math.pi)
    return math.dist(one[:2], other[:2]) < LIMITS[0] and turn < LIMITS[1]


def test_the_best_of_places_close_together_is_kept():
    poses = np.array([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (9.0, 0.0, 0.0)])
    assert distinct(poses, np.array([1.0, 2.0, 0.5]), *LIMITS, 5).tolist() == [1, 2]
    assert distinct(poses, np.array([1.0, 2.0, 0.5]), *LIMITS, 1).tolist() == [1]


def test_a_turn_makes_another_place_and_a_whole_circle_does_not():
    poses = np.array([(0.0, 0.0, -math.pi), (0.0, 0.0, math.pi - 0.1), (0.0, 0.0, -math.pi + 0.2)])
    assert distinct(poses, np.array([3.0, 2.0, 1.0]), *LIMITS, 5).tolist() == [0, 2]


def test_the_distance_itself_is_apart():
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    assert distinct(poses, np.zeros(2), *LIMITS, 5).tolist() == [0, 1]


def test_of_nothing_nothing_is_kept():
    assert distinct(np.empty((0, 3)), np.empty(0), *LIMITS, 5).tolist() == []


@given(st.integers(1, 30).flatmap(lambda n: arrays(np.float64, (n, 4), elements=st.floats(-3.0, 3.0))))
def test_what_is_kept_is_apart_and_what_is_not_is_near_something_better(drawn):
    poses, scores = drawn[:, :3], drawn[:, 3]
    kept = distinct(poses, scores, *LIMITS, len(poses)).tolist()
    assert list(scores[kept]) == sorted(scores[kept], reverse=True)
    for place, index in enumerate(kept):
        assert not any(is_near(poses[index], poses[other]) for other in kept[:place])
    for index in set(range(len(poses))) - set(kept):
        assert any(is_near(poses[index], poses[other]) and scores[other] >= scores[index] for other in kept)


def layout(grid, cell=0.2):
    return _Layout.of(structure(grid), cell, 0.3)


def test_turns_are_so_fine_that_a_wall_far_from_the_centre_moves_by_a_cell(rooms):
    walls = structure(rooms(3))
    turns = np.unique([one.theta % (2.0 * math.pi) for one in propose(walls, walls, CONFIG).motions])
    step, cell = np.diff(turns).min(), _cell_size(walls, walls, CONFIG)
    assert step == pytest.approx(cell / layout(rooms(3), cell).spread(), rel=0.05)


def test_the_ways_that_walls_face_are_smoothed_over_two_degrees():
    """The mean of many walls that face one way, whatever their number; seen in steps of a degree or less."""
    grid = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 60, 60))
    grid.masses[20:40, 10:50] = (0.0, 1.0, 0.0, 0.0)
    grid.masses[18:20, 10:50] = (0.0, 0.0, 1.0, 0.0)
    facing = _directions(layout(grid))
    degrees = (np.arange(len(facing)) * 360.0 / len(facing) - np.argmax(facing) * 360.0 / len(facing) + 180.0) % 360.0
    near = np.abs(degrees - 180.0) < 10.0
    spread = math.sqrt(np.average((degrees[near] - 180.0) ** 2, weights=np.maximum(facing[near], 0.0)))
    assert spread == pytest.approx(2.0, abs=0.35)


@pytest.mark.parametrize("cell", [0.21, 0.23])
def test_scores_stay_within_their_arrays(rooms, monkeypatch, cell):
    """Python checks every index, which compiled loops do not."""
    walls = structure(rooms(2))
    search = _Search.of(walls, walls, cell, CONFIG)
    expected = search.scores(0.3)
    monkeypatch.setattr(correlation, "multiply", correlation.multiply.py_func)
    np.testing.assert_allclose(search.scores(0.3), expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("shift_m", "turn", "same"), [(0.9, 0.0, True), (1.1, 0.0, False), (0.0, 0.14, True), (0.0, -0.16, False)]
)
def test_two_poses_are_one_place_if_the_centroid_of_the_walls_hardly_moves(rooms, shift_m, turn, same):
    source, motion = structure(rooms(3)), SE2(-31.0, 8.0, 2.5)
    centroid = SE2(*map(float, source.centroid), 0.0)
    other = motion @ centroid @ SE2(shift_m, 0.0, turn) @ centroid.inverse()
    assert (other in same_place([other], motion, source)) == same
