import numpy as np
import pytest

from datasets.synthetic.buildings import WORLDS, make_world
from datasets.synthetic.robot.drives import ClearanceMap
from tbmslam.belief.masses import FREE


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_almost_every_place_is_reached(name, seed):
    world = make_world(name, seed)
    around = ClearanceMap.of(world)
    reached = [
        (around.at(place + np.random.default_rng(0).uniform(-1, 1, (50, 2))) > 0.0).any() for place in world.places
    ]
    assert np.mean(reached) >= 0.9


@pytest.mark.parametrize("name", WORLDS)
def test_the_same_seed_is_the_same_building(name):
    first, second = make_world(name, 4), make_world(name, 4)
    np.testing.assert_array_equal(first.walls, second.walls)
    np.testing.assert_array_equal(first.places, second.places)


@pytest.mark.parametrize("name", [name for name in WORLDS if name != "corridor"])
def test_another_seed_is_another_building(name):
    first, second = (make_world(name, seed) for seed in (1, 2))
    geometry = first.grid(0.25)
    free = [world.occupancy(geometry) == FREE for world in (first, second)]
    overlap = (free[0] & free[1]).sum() / (free[0] | free[1]).sum()
    assert overlap < 0.93


def test_an_office_is_about_40_by_25_m():
    for seed in range(5):
        min_x, min_y, max_x, max_y = make_world("office", seed).bounds()
        assert 35 < max_x - min_x < 44
        assert 22 < max_y - min_y < 28


def test_a_hospital_is_large_and_few_of_its_rooms_are_visited():
    for seed in range(4):
        world = make_world("hospital", seed)
        min_x, min_y, max_x, max_y = world.bounds()
        assert 90 < max_x - min_x < 240
        assert 35 < max_y - min_y < 105
        assert len(world.places) < 200


def test_a_corridor_repeats_itself():
    walls = make_world("corridor", 0).walls
    moved = walls + np.array([4.0, 0.0, 4.0, 0.0])
    distance = np.abs(moved[:, None] - walls[None]).max(axis=2).min(axis=1)
    assert (distance < 1e-6).mean() > 0.9


def test_variety_changes_the_kind():
    areas = [
        np.prod(np.subtract(make_world("variety", s).bounds()[2:], make_world("variety", s).bounds()[:2]))
        for s in range(6)
    ]
    assert max(areas) > 2 * min(areas)


def test_unknown_names_and_negative_seeds_are_refused():
    with pytest.raises(ValueError, match=r"name must be one of office, .*, got 'castle'"):
        make_world("castle")
    with pytest.raises(ValueError, match="seed must not be negative, got -1"):
        make_world("office", -1)
