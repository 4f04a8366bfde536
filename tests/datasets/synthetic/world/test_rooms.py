import numpy as np
import pytest

from datasets.synthetic.world.clearance import ClearanceMap
from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.rooms import CorridorSide, add_rooms, furnish, stand_box


def test_furniture_stands_in_the_room_and_off_the_way():
    room, way = Rectangle(0, 0, 5, 4), Rectangle(2, 0, 3, 1.2)
    for seed in range(20):
        plan = FloorPlan()
        plan.carve(room)
        plan.keep_clear(way)
        furnish(plan, room, np.random.default_rng(seed))
        plan.add_place(2.5, 2.0)
        world = plan.world("room", 0)
        points = world.walls.reshape(-1, 2) - (world.places[0] - [2.5, 2.0])
        assert points.min() > -0.1
        assert (points.max(axis=0) < [5.1, 4.1]).all()
        inside = (points > [2.05, 0.05]).all(axis=1) & (points < [2.95, 1.15]).all(axis=1)
        assert not inside.any()
        assert len(world.walls) > 8


def test_a_box_needs_room():
    plan = FloorPlan()
    room = Rectangle(0, 0, 2, 2)
    rng = np.random.default_rng(0)
    assert stand_box(plan, room, rng)
    assert not any(stand_box(plan, room, rng) for _ in range(20))


@pytest.mark.parametrize(
    ("direction", "expected"), [("north", (2, 13)), ("south", (2, 7)), ("east", (13, 2)), ("west", (7, 2))]
)
def test_sides_map_along_and_away(direction, expected):
    side = CorridorSide(direction, 10.0)
    np.testing.assert_allclose(side.points(np.array([2.0, 3.0])), expected)
    room = side.rectangle(1.0, 0.0, 2.0, 3.0)
    np.testing.assert_allclose(room.centre, side.points(np.array([1.5, 1.5])))
    assert sorted((room.width, room.height)) == [1.0, 3.0]


@pytest.mark.parametrize("direction", ["north", "south", "east", "west"])
def test_every_room_is_entered_from_the_corridor(direction):
    side = CorridorSide(direction, 0.0)
    plan = FloorPlan()
    plan.carve(side.rectangle(0.0, -2.0, 25.0, 0.0))
    plan.add_place(*side.rectangle(0.0, -2.0, 25.0, 0.0).centre)
    add_rooms(plan, side, (0.0, 25.0), 5.0, np.random.default_rng(2))
    world = plan.world("row", 0)
    assert len(world.places) > 4
    around = ClearanceMap.of(world)
    near = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    assert all((around.at(place + near) > 0).any() for place in world.places)


def test_rooms_that_meet_no_corridor_are_left_out():
    plan = FloorPlan()
    plan.carve(Rectangle(10.0, -2.0, 20.0, 0.0))
    add_rooms(plan, CorridorSide("north", 0.0), (0.0, 9.0), 4.0, np.random.default_rng(0), (10.0, 20.0))
    plan.add_place(15.0, -1.0)
    assert len(plan.world("none", 0).walls) == 4
