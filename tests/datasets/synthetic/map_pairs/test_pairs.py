from collections import Counter
from functools import partial

import numpy as np
import pytest

from datasets.synthetic.map_pairs.distortion import Distortion
from datasets.synthetic.map_pairs.pairs import (
    Building,
    building_of_area,
    building_of_world,
    cut_pairs,
    disjoint_pair,
    foreign_pair,
    maps_of,
    maps_of_far_ends,
    maps_of_mirrored,
    mirrored,
    room_of,
)


@pytest.fixture(scope="module")
def small():
    return room_of(building_of_world("office", 3), 60.0, 1)


def common_share(pair):
    """Share of the smaller map's free cells that the other knows as free, by the true motion."""
    rows, cols = np.nonzero((pair.occ_b >= 0) & (pair.occ_b < 50))
    moved = pair.T_a_b.apply((np.column_stack((cols, rows)) + 0.5) * pair.resolution)
    col, row = np.floor(moved / pair.resolution).astype(int).T
    inside = (row >= 0) & (row < pair.occ_a.shape[0]) & (col >= 0) & (col < pair.occ_a.shape[1])
    free = np.zeros(len(moved), dtype=bool)
    here = pair.occ_a[row[inside], col[inside]]
    free[inside] = (here >= 0) & (here < 50)
    return free.sum() / min(len(moved), ((pair.occ_a >= 0) & (pair.occ_a < 50)).sum())


def test_maps_overlap_as_asked_under_the_true_motion(small):
    for pair in cut_pairs(small, 1, (1.0, 0.5, 0.25)):
        assert common_share(pair) == pytest.approx(pair.overlap, abs=0.15)
        assert np.unique(pair.occ_a).min() == -1


def test_a_seed_gives_the_same_pair_and_another_seed_another(small):
    first, again, other = (next(iter(cut_pairs(small, seed, (0.5,)))) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.occ_a, again.occ_a)
    assert first.T_a_b == again.T_a_b
    assert first.T_a_b != other.T_a_b


def test_negatives_have_no_motion(small, tmp_path):
    for pair in (disjoint_pair(small, 1), foreign_pair(small, mirrored(small), 1)):
        assert pair.T_a_b is None
        with np.load(pair.save(tmp_path)) as arrays:
            assert int(arrays["label"]) == 0
            assert np.isnan(arrays["T_ab"]).all()


def test_buildings_of_other_resolutions_make_no_pair(small):
    coarse = Building("coarse", small.occupancy, 0.1)
    with pytest.raises(ValueError, match=r"buildings must have one resolution, got 0\.05 and 0\.1"):
        foreign_pair(small, coarse, 1)


def test_a_floor_has_the_size_that_was_asked_for():
    floor = building_of_area(1600.0, seed=0, resolution=0.1)
    assert floor.occupancy.shape == (400, 400)
    assert {-1, 0, 100} == set(np.unique(floor.occupancy))
    free = (floor.occupancy == 0).mean()
    assert 0.15 < free < 0.6  # corridors and niches between blocks of rock


def test_the_truth_of_maps_that_bend_is_where_they_fit_what_both_saw(small):
    bend = partial(Distortion.of_another_time, deformation_m=0.3)
    pair = next(iter(cut_pairs(small, 1, (0.5,), bend)))
    assert common_share(pair) == pytest.approx(0.5, abs=0.1)


def test_a_point_lies_where_it_was_read(small):
    rng = np.random.default_rng(3)
    floor = np.zeros_like(small.occupancy)
    row, col = (size // 2 for size in floor.shape)
    floor[row - 2 : row + 3, col - 2 : col + 3] = 100
    exact = Distortion(0.7, 0.3, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    distorted = exact.distort(floor, small.resolution, rng)
    seen = np.argwhere(distorted.occupancy > 50).mean(axis=0)[::-1]
    there = distorted.laid((np.array([[col, row]]) + 0.5) * small.resolution)[0]
    np.testing.assert_allclose((seen + 0.5) * small.resolution, there, atol=0.7 * small.resolution)


def test_points_are_found_in_the_most_distorted_maps():
    floor = building_of_world("apartment", 1, 0.1)
    points = (np.argwhere(floor.occupancy >= 0)[::50, ::-1] + 0.5) * floor.resolution
    for seed in range(3):
        rng = np.random.default_rng(seed)
        distorted = Distortion.of_another_time(rng, 2.0).distort(floor.occupancy, floor.resolution, rng)
        read = distorted.T_map_building.inverse().apply(distorted.laid(points))
        np.testing.assert_allclose(read + distorted.displacements(read), points, atol=floor.resolution)


def walls(one):
    """Wall cells in the building's frame, to half a metre."""
    rows, cols = np.nonzero(one.occupancy > 50)
    points = one.T_map_building.inverse().apply((np.column_stack((cols, rows)) + 0.5) * one.resolution)
    return set(map(tuple, np.round(points * 2.0).astype(int).tolist()))


def test_maps_of_one_place_have_their_walls_at_one_place(small):
    maps = list(maps_of(small, 3, np.random.default_rng(0)))
    assert [one.place for one in maps] == [small.name] * 3
    here = walls(type(maps[0])(small.name, small.occupancy, small.resolution, maps[0].T_map_building.identity()))
    for one in maps:
        found = walls(one)
        assert len(found & here) > 0.5 * len(found)  # the rest is speckle and clutter


def test_far_ends_are_two_places_that_share_nothing(small):
    maps = list(maps_of_far_ends(small, 2, np.random.default_rng(0)))
    assert Counter(one.place for one in maps) == {f"{small.name} end 0": 2, f"{small.name} end 1": 2}
    ends = [walls(one) for one in maps]
    assert len(ends[0] & ends[1]) > 3 * len(ends[0] & ends[2])


def test_a_mirror_image_is_another_place(small):
    maps = list(maps_of_mirrored(small, 2, np.random.default_rng(0)))
    assert Counter(one.place for one in maps) == {small.name: 2, f"{small.name}mir": 2}
