"""Maps of several small floors; of each floor two robots saw overlapping parts."""

import itertools

import numpy as np
import pytest

from merging import MergeConfig, merge
from merging.config.registration import StructureConfig
from merging.fusion.warping import warp
from merging.retrieval import MapPlaces, likeness, pairs_to_align
from merging.walls.wall_map import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor
from tests.merging.conftest import draw_rooms, grid_of_occupancy

FLOORS = range(1, 6)


def with_neighbours(count):
    return MergeConfig.model_validate({"nonrigid": {"enabled": False}, "retrieval": {"neighbours": count}})


def seen(floor, cols, T_map_floor):
    """Return the map of the columns of a floor that a robot saw, in the robot's frame."""
    part = np.full_like(floor, -1)
    part[:, cols] = floor[:, cols]
    grid = grid_of_occupancy(part, 0.05)
    return TbmMap(warp(grid, T_map_floor, GridGeometry(0.05, -20.0, -20.0, 800, 800)))


@pytest.fixture(scope="module")
def maps():
    parts = {"left": (np.s_[:240], SE2(-2.0, 1.0, 0.4)), "right": (np.s_[80:], SE2(3.0, 4.0, -2.0))}
    return {
        f"{floor} {side}": seen(draw_rooms(floor), cols, pose)
        for floor, (side, (cols, pose)) in itertools.product(FLOORS, parts.items())
    }


def places_of(tbm_map):
    return MapPlaces.of(WallMap.from_grid(tbm_map.grid, StructureConfig()))


def ranks_of_siblings(alike):
    """Return how many maps look more like each map than the other map of its floor does."""
    return np.array([(alike[index] > alike[index, index ^ 1]).sum() for index in range(2 * len(FLOORS))])


def test_maps_of_one_floor_look_most_alike(maps):
    alike = likeness([places_of(one) for one in maps.values()])
    np.testing.assert_array_equal(alike, alike.T)
    assert (ranks_of_siblings(alike) < 2).all()
    assert (ranks_of_siblings(alike) == 0).sum() >= 8


def test_signatures_do_not_depend_on_the_frame():
    floor = draw_rooms(3)
    first, second = (places_of(seen(floor, np.s_[:], pose)) for pose in (SE2(0.0, 0.0, 0.0), SE2(4.0, 3.0, 1.0)))
    lengths = np.linalg.norm(first.signatures, axis=1)
    similarities = first.signatures @ second.signatures.T / lengths[:, None] / np.linalg.norm(second.signatures, axis=1)
    assert np.median(similarities.max(axis=1)) > 0.95


def test_similarities_are_exact_whole_numbers(maps):
    signatures = places_of(maps["1 left"]).signatures
    exact = signatures.astype(np.int64) @ signatures.astype(np.int64).T
    np.testing.assert_array_equal(signatures @ signatures.T, exact)
    assert exact.max() < 2**24


def test_a_few_maps_are_aligned_in_all_pairs(maps):
    every_pair = list(itertools.combinations(maps, 2))
    assert pairs_to_align(maps, with_neighbours(len(maps) - 1), Executor()) == every_pair
    assert pairs_to_align(maps, MergeConfig(), Executor()) == every_pair
    by_keypoints = with_neighbours(1).model_copy(update={"method": "features"})
    assert len(pairs_to_align(maps, by_keypoints, Executor())) == 45


def test_each_of_many_maps_is_aligned_with_those_most_like_it(maps):
    pairs = pairs_to_align(maps, with_neighbours(2), Executor())
    assert {(f"{floor} left", f"{floor} right") for floor in FLOORS} <= set(pairs)
    assert all(any(name in pair for pair in pairs) for name in maps)
    assert pairs == sorted(pairs)
    assert len(pairs) <= 20


def test_a_map_without_walls_is_like_none(maps):
    empty = TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20)))
    assert len(places_of(empty)) == 0
    alike = likeness([places_of(one) for one in (*maps.values(), empty)])
    assert (alike[-1] == -np.inf).all()
    np.testing.assert_array_equal(alike[:-1, :-1], likeness([places_of(one) for one in maps.values()]))


def test_merging_many_maps_aligns_few_pairs_and_says_which_maps_it_left_apart(maps):
    found = merge(maps, with_neighbours(1))
    assert set(found.poses) == {"1 left", "1 right"}
    assert len(found.alignments) <= len(maps)
    assert found.alignments.keys() >= {("1 left", "1 right"), ("2 left", "2 right")}
    assert "none of the merged maps looks like it" in found.left_out["2 left"]
