import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datasets.synthetic.robot.drives import ClearanceMap
from datasets.synthetic.world.floor_plan import CorridorSide, FloorPlan, Rectangle, add_rooms, furnish, place_box

sides = st.tuples(st.integers(0, 8), st.integers(0, 8), st.integers(1, 6), st.integers(1, 6))
strokes = st.lists(st.tuples(sides, st.booleans()), min_size=1, max_size=12)


def wall_lengths(plan):
    plan.add_place(0.0, 0.0)
    walls = plan.world("test", 0).walls
    return np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])


def test_one_room_has_four_walls():
    plan = FloorPlan()
    plan.carve(Rectangle(0, 0, 4, 3))
    assert sorted(wall_lengths(plan)) == pytest.approx([3, 3, 4, 4])


def test_a_door_joins_two_rooms():
    plan = FloorPlan()
    plan.carve(Rectangle(0, 0, 4, 3))
    plan.carve(Rectangle(4.2, 0, 8, 3))
    plan.carve(Rectangle(4, 1, 4.2, 2))
    lengths = wall_lengths(plan)
    assert len(lengths) == 12
    assert sum(lengths) == pytest.approx(2 * (4 + 3) + 2 * (3.8 + 3) - 2 * 1 + 2 * 0.2)


@settings(max_examples=60, deadline=None)
@given(strokes)
def test_walls_are_the_border_of_what_the_last_stroke_left(drawn):
    plan = FloorPlan()
    solid = np.ones((16, 16), dtype=bool)
    for (x, y, width, height), is_solid in drawn:
        rectangle = Rectangle(x, y, x + width, y + height)
        (plan.fill if is_solid else plan.carve)(rectangle)
        solid[x + 1 : x + width + 1, y + 1 : y + height + 1] = is_solid
    border = (solid[1:] != solid[:-1]).sum() + (solid[:, 1:] != solid[:, :-1]).sum()
    if border:
        assert sum(wall_lengths(plan)) == pytest.approx(border)


def test_things_keep_off_one_another_and_off_ways():
    plan = FloorPlan()
    plan.carve(Rectangle(0, 0, 10, 10))
    plan.keep_clear(Rectangle(4, 4, 6, 6))
    assert plan.try_box(Rectangle(1, 1, 2, 2))
    assert not plan.try_box(Rectangle(1.5, 1.5, 3, 3))
    assert not plan.try_box(Rectangle(2.1, 1, 3, 2), margin=0.2)
    assert not plan.try_box(Rectangle(5, 5, 5.5, 5.5))
    assert not plan.try_box(Rectangle(6.05, 4, 7.05, 5), turn=0.7)
    assert plan.try_column(8, 8, 0.3)
    assert not plan.try_column(8.4, 8, 0.3)
    assert len(wall_lengths(plan)) == 4 + 4 + 12


def test_rectangles_know_their_relations():
    room = Rectangle(0, 0, 4, 2)
    assert (room.width, room.height, room.centre) == (4, 2, (2, 1))
    assert room.overlaps(Rectangle(3, 1, 5, 3))
    assert not room.overlaps(Rectangle(4, 0, 5, 2))
    assert room.grown(0.5) == Rectangle(-0.5, -0.5, 4.5, 2.5)


def test_furniture_is_in_the_room_and_leaves_the_doors_free():
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
    assert place_box(plan, room, rng)
    assert not any(place_box(plan, room, rng) for _ in range(20))


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
