import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from datasets.synthetic.buildings import make_world
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.evaluation.map_agreement import MapRefinementError, cell_labels, map_agreement, refine_map_transform
from tbmslam.geometry.se2 import SE2

LABELS = hnp.arrays(np.uint8, (6, 5), elements=st.sampled_from([FREE, OCCUPIED, UNKNOWN]))


def grid_of(*cells):
    masses = np.array([cells], dtype=np.float32)
    return TbmGrid(GridGeometry(0.1, 0.0, 0.0, 1, len(cells)), masses)


def test_labels_follow_the_larger_mass():
    grid = grid_of((0, 0, 0, 1), (0, 0.1, 0, 0.9), (0, 0.2, 0.3, 0.5), (0.8, 0.1, 0.1, 0), (0.5, 0.2, 0.1, 0.2))
    assert cell_labels(grid)[0].tolist() == [UNKNOWN, FREE, OCCUPIED, UNKNOWN, FREE]


def test_little_evidence_is_none():
    grid = grid_of((0, 0.1, 0, 0.9), (0, 0.2, 0.3, 0.5), (0.5, 0.2, 0.1, 0.2))
    assert cell_labels(grid, min_evidence=0.5)[0].tolist() == [UNKNOWN, UNKNOWN, FREE]


def test_shares_of_a_known_case():
    f, o, u = FREE, OCCUPIED, UNKNOWN
    labels = np.array([[f, f, f, o, o, u, f]], dtype=np.uint8)
    truth = np.array([[f, f, o, o, f, o, u]], dtype=np.uint8)
    agreement = map_agreement(labels, truth)
    assert (agreement.known_both, agreement.known_map, agreement.known_truth) == (5, 6, 6)
    assert agreement.agree == pytest.approx(3 / 5)
    assert (agreement.agree_occupied, agreement.agree_free) == pytest.approx((1 / 2, 2 / 3))
    assert (agreement.found_occupied, agreement.found_free) == pytest.approx((1 / 2, 2 / 3))
    assert agreement.wall_distance == pytest.approx((0 + 1) / 2)


def test_a_wall_in_the_next_cell_agrees_nearby_and_one_two_cells_off_does_not():
    f, o = FREE, OCCUPIED
    truth = np.array([[f, f, f, o, f, f, f, f]], dtype=np.uint8)
    beside = map_agreement(np.roll(truth, 1, axis=1), truth)
    assert (beside.agree, beside.agree_nearby) == pytest.approx((6 / 8, 1.0))
    apart = map_agreement(np.roll(truth, 2, axis=1), truth)
    assert (apart.agree, apart.agree_nearby) == pytest.approx((6 / 8, 6 / 8))


@given(LABELS, LABELS)
def test_roles_swap(labels, truth):
    there, back = map_agreement(labels, truth), map_agreement(truth, labels)
    assert (there.known_both, there.known_map) == (back.known_both, back.known_truth)
    np.testing.assert_equal(
        (there.agree, there.agree_nearby, there.agree_occupied, there.agree_free),
        (back.agree, back.agree_nearby, back.found_occupied, back.found_free),
    )


@given(LABELS)
def test_a_map_agrees_with_itself(labels):
    agreement = map_agreement(labels, labels)
    known = int((labels != UNKNOWN).sum())
    assert agreement.known_both == known
    assert np.isnan(agreement.agree) if not known else agreement.agree == agreement.agree_nearby == 1.0


def test_shapes_must_agree():
    with pytest.raises(ValueError, match=r"labels and truth must have the same shape, got \(2, 3\) and \(3, 2\)"):
        map_agreement(np.zeros((2, 3), np.uint8), np.zeros((3, 2), np.uint8))


@pytest.mark.parametrize("guess_error", [SE2(0.0, 0.0, 0.0), SE2(0.5, -0.4, 0.03), SE2(-0.3, 0.6, -0.05)])
def test_a_part_of_a_world_is_placed_on_the_whole(guess_error):
    world = make_world("apartment", 3)
    geometry = world.grid(0.05)
    T_world_map = SE2(4.0, 7.0, 0.7)
    own = GridGeometry(0.05, 0.0, 0.0, 120, 160)
    labels = world.occupancy(own, T_world_map)
    found = refine_map_transform(labels, own, world.occupancy(geometry), geometry, T_world_map @ guess_error)
    left = T_world_map.inverse() @ found
    assert np.hypot(left.x, left.y) < 0.02
    assert abs(np.degrees(left.theta)) < 0.2


def test_a_map_without_walls():
    geometry = GridGeometry(0.05, 0.0, 0.0, 4, 4)
    nothing = np.full((4, 4), UNKNOWN, dtype=np.uint8)
    with pytest.raises(
        MapRefinementError, match="one of the maps has no occupied cell, so the transform cannot be refined"
    ):
        refine_map_transform(nothing, geometry, nothing, geometry, SE2.identity())
