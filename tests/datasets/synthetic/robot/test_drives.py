import math
from itertools import pairwise

import numpy as np
import pytest

from datasets.synthetic.buildings import WORLDS, make_world
from datasets.synthetic.robot.drives import ClearanceMap, RoadMap, drive_along, plan_drives, short_tour
from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle

ALL_WORLDS = [pytest.param(name, marks=[pytest.mark.slow] if name == "hospital" else []) for name in WORLDS]


@pytest.mark.parametrize("name", ALL_WORLDS)
def test_robots_keep_off_walls_and_drive_as_robots_can(name):
    world = make_world(name, 1)
    around = ClearanceMap.of(world)
    for drive in plan_drives(world, 2, duration=60.0, seed=1):
        assert len(drive) == 60 * 50 + 1
        assert around.at(drive.poses[:, :2]).min() > 0.25
        steps = np.hypot(*np.diff(drive.poses[:, :2], axis=0).T)
        turns = np.abs((np.diff(drive.poses[:, 2]) + np.pi) % (2 * np.pi) - np.pi)
        assert steps.max() * 50 <= 0.65 + 1e-9
        assert turns.max() * 50 <= 0.9 + 1e-9
        assert drive.length() > 15.0
        np.testing.assert_allclose(np.diff(drive.stamps), 0.02, atol=1e-6)


def test_one_robot_sees_the_whole_office_and_returns():
    world = make_world("office", 2)
    (drive,) = plan_drives(world, 1, seed=3)
    nearest = [np.hypot(*(drive.poses[:, :2] - place).T).min() for place in world.places]
    assert np.mean(np.array(nearest) < 2.5) > 0.9
    assert np.hypot(*(drive.poses[0, :2] - drive.poses[-1, :2])) < 2.0


def test_neighbours_share_a_part_and_start_apart():
    world = make_world("office", 1)
    first, second, third = (drive.poses[::25, :2] for drive in plan_drives(world, 3, length=50.0, overlap=0.3, seed=2))

    def shared(a, b):
        return (np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1)).min(axis=1) < 1.0).mean()

    assert 0.1 < shared(first, second) < 0.8
    assert 0.1 < shared(second, third) < 0.8
    assert shared(first, third) < shared(second, third)
    assert np.hypot(*(first[0] - second[0])) > 3.0


def test_a_length_is_kept_even_beyond_the_tour():
    world = make_world("corridor", 1)
    (drive,) = plan_drives(world, 1, length=220.0, seed=0)
    assert drive.length() == pytest.approx(220.0, abs=0.05)


def test_the_same_seed_is_the_same_drive_and_another_is_not():
    world = make_world("apartment", 0)
    first, again, other = (plan_drives(world, 1, length=20.0, seed=seed)[0] for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.poses, again.poses)
    assert not np.allclose(first.poses[:500], other.poses[:500])


@pytest.mark.parametrize("seed", range(5))
def test_a_tour_visits_all_once_and_is_shorter_than_chance(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 10, (25, 2))
    costs = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    tour = short_tour(costs, start=7)
    assert tour[0] == 7
    assert sorted(tour) == list(range(25))
    assert costs[tour, np.roll(tour, -1)].sum() < 0.6 * costs[np.arange(25), np.roll(np.arange(25), -1)].sum()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"robots": 0}, "robots must be at least 1 and at most 1000, got 0"),
        ({"overlap": 1.0}, r"overlap must be within 0 to 0\.9, got 1\.0"),
        ({"length": -1.0}, r"length must be positive, got -1\.0"),
        ({"duration": 0.0}, r"duration must be positive, got 0\.0"),
        ({"speed": float("nan")}, "speed must be positive, got nan"),
    ],
)
def test_wrong_arguments_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        plan_drives(make_world("corridor", 0), **wrong)


def line(*corners):
    points = [np.linspace(a, b, round(math.dist(a, b) / 0.1), endpoint=False) for a, b in pairwise(corners)]
    return np.vstack([*points, [corners[-1]]])


def test_a_straight_path_is_driven_straight_to_its_end():
    drive = drive_along(line((1, 1), (1, 9)), 0.5, np.random.default_rng(0), 100.0)
    np.testing.assert_allclose(drive.poses[:, 0], 1.0, atol=1e-9)
    np.testing.assert_allclose(drive.poses[:, 2], math.pi / 2)
    assert abs(drive.poses[-1, 1] - 9.0) < 0.1
    assert drive.stamps[0] == 100.0


def test_a_robot_turns_back_where_the_path_does():
    drive = drive_along(line((0, 0), (4, 0), (0, 0)), 0.6, np.random.default_rng(1), 0.0)
    assert 3.5 < drive.poses[:, 0].max() < 4.2
    assert np.abs(drive.poses[:, 1]).max() < 0.25
    assert np.hypot(*drive.poses[-1, :2]) < 0.1


def test_a_corner_is_cut_by_little():
    path = line((0, 0), (5, 0), (5, 5))
    drive = drive_along(path, 0.7, np.random.default_rng(2), 0.0)
    off = np.hypot(*(drive.poses[:, None, :2] - path[None]).transpose(2, 0, 1)).min(axis=1)
    assert off.max() < 0.2


def test_length_and_duration_end_a_drive():
    path = line((0, 0), (50, 0))
    assert abs(drive_along(path, 0.6, np.random.default_rng(0), 0.0, length=7.0).length() - 7.0) < 0.02
    assert drive_along(path, 0.6, np.random.default_rng(0), 0.0, duration=12.0).stamps[-1] == 12.0


def two_rooms():
    plan = FloorPlan()
    plan.carve(Rectangle(0, 0, 4, 4))
    plan.carve(Rectangle(4.2, 0, 8, 4))
    plan.carve(Rectangle(4, 0.2, 4.2, 1.4))
    plan.add_place(2, 2)
    world = plan.world("two rooms", 0)
    return world, ClearanceMap.of(world)


def test_clearance_is_the_distance_to_the_nearest_wall():
    world, around = two_rooms()
    points = world.places[0] + np.array([[0, 0], [1, 0], [0, -1.5], [100, 0], [-2.3, 0]])
    np.testing.assert_allclose(around.at(points), [2, 1, 0.5, 0, 0], atol=0.06)


def test_a_way_leads_through_the_door_and_keeps_off_walls():
    world, around = two_rooms()
    for rng in (None, np.random.default_rng(3)):
        roads = RoadMap(around, 0.4, rng)
        start, end = roads.nearest(world.places[0] + np.array([[0.0, 1.5], [4.2, 1.5]]))
        way = roads.path(int(start), int(end))
        np.testing.assert_allclose(way[[0, -1]], roads.points[[start, end]])
        assert around.at(way).min() >= 0.4
        assert np.hypot(*np.diff(way, axis=0).T).max() < 0.15
        assert way[:, 1].min() < world.places[0, 1] - 0.5
        assert len(roads.path(int(start), int(start))) == 1


def test_costs_are_symmetric_and_at_least_lengths():
    world, around = two_rooms()
    roads = RoadMap(around, 0.4)
    nodes = roads.nearest(world.places[0] + np.array([[0.0, 0], [1, 1], [4.2, 0]]))
    costs = roads.costs(nodes)
    np.testing.assert_allclose(costs, costs.T)
    apart = np.hypot(*(roads.points[nodes][:, None] - roads.points[nodes][None]).transpose(2, 0, 1))
    assert (costs >= apart - 1e-9).all()
    assert costs[0, 2] > 5.0
