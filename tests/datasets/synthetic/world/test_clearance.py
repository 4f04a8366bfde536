import numpy as np

from datasets.synthetic.world.clearance import ClearanceMap, RoadMap
from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle


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
