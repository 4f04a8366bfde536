from collections import Counter

import numpy as np
import pytest

from datasets.synthetic.map_pairs.pairs import building_of_world, room_of
from datasets.synthetic.map_pairs.sets import maps_of, maps_of_far_ends, maps_of_mirrored


@pytest.fixture(scope="module")
def small():
    return room_of(building_of_world("office", 3), 60.0, 1)


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
