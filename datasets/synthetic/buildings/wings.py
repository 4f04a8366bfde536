"""Corridors with dead ends: a main one, and wings that leave it at right angles."""

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.room_row import CorridorSide, add_rooms


def draw_wings(rng: np.random.Generator) -> FloorPlan:
    """Draw a main corridor of about 40 m and one or two wings, rooms along all of them."""
    plan = FloorPlan()
    length, width = float(rng.uniform(34.0, 44.0)), float(rng.uniform(1.8, 2.6))
    plan.carve(Rectangle(0.0, 0.0, length, width))
    for x in np.arange(2.0, length - 1.0, 6.0):
        plan.add_place(float(x), width / 2.0)
    north = _add_wing(plan, CorridorSide("north", width), length * float(rng.uniform(0.3, 0.7)), rng)
    _add_main_rooms(plan, CorridorSide("north", width), (0.0, *north, length), rng)
    if rng.random() < 0.6:
        south = _add_wing(plan, CorridorSide("south", 0.0), length * float(rng.uniform(0.25, 0.75)), rng)
        _add_main_rooms(plan, CorridorSide("south", 0.0), (0.0, *south, length), rng)
    else:
        add_rooms(plan, CorridorSide("south", 0.0), (0.0, length), float(rng.uniform(4.0, 6.0)), rng)
    return plan


def _add_wing(plan: FloorPlan, side: CorridorSide, middle: float, rng: np.random.Generator) -> tuple[float, float]:
    """Add a wing with rooms left and right; return how much of the main corridor it takes."""
    width, length = float(rng.uniform(1.7, 2.3)), float(rng.uniform(12.0, 19.0))
    start, end = middle - width / 2.0, middle + width / 2.0
    corridor = side.rectangle(start, 0.0, end, length)
    plan.carve(corridor)
    for v in np.arange(3.0, length, 6.0):
        x, y = side.points(np.array([middle, v]))
        plan.add_place(float(x), float(y))
    depths = rng.uniform(3.8, 5.5, 2).tolist()
    wall = 0.2  # to the main corridor
    extent = (corridor.y0 + wall, corridor.y1) if side.direction == "north" else (corridor.y0, corridor.y1 - wall)
    add_rooms(plan, CorridorSide("west", start), extent, depths[0], rng)
    add_rooms(plan, CorridorSide("east", end), extent, depths[1], rng)
    return start - depths[0] - 0.2, end + depths[1] + 0.2


def _add_main_rooms(
    plan: FloorPlan, side: CorridorSide, limits: tuple[float, float, float, float], rng: np.random.Generator
) -> None:
    """Add rooms along the main corridor on both sides of a wing."""
    depth = float(rng.uniform(4.0, 6.0))
    for start, end in ((limits[0], limits[1]), (limits[2], limits[3])):
        if end - start > 2.6:
            add_rooms(plan, side, (start, end), depth, rng)
