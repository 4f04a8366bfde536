import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle

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
