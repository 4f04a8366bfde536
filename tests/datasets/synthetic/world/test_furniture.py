import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.furniture import furnish, stand_box


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
