"""Rooms that open into one another, without a corridor."""

import numpy as np

from datasets.synthetic.buildings.subdivision import cut, join
from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.furniture import furnish


def draw_apartment(rng: np.random.Generator) -> FloorPlan:
    """Draw 15 to 30 rooms of 3 to 7 m."""
    plan = FloorPlan()
    area = Rectangle(0.0, 0.0, float(rng.uniform(22.0, 32.0)), float(rng.uniform(15.0, 22.0)))
    wall = float(rng.uniform(0.12, 0.25))
    rooms = cut(area, 6.0, wall, rng)
    for room in rooms:
        plan.carve(room)
    join(plan, rooms, wall, (1.0, 1.6), rng)
    for room in rooms:
        furnish(plan, room, rng, density=float(rng.uniform(0.3, 1.0)))
        plan.add_place(*room.centre)
    return plan
