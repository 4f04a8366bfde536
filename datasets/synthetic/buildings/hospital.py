"""A large building: long corridors that cross, around courts, with rooms along all of them."""

from itertools import pairwise

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.room_row import CorridorSide, add_rooms

_WALL = 0.2
_VISITED = 0.12
"""Share of the rooms a robot looks into: it is the long ways between them that make a large building hard."""
_STEP = 7.0
"""Between places along a corridor [m]."""


def draw_hospital(rng: np.random.Generator) -> FloorPlan:
    """Draw two or three corridors of 90 to 220 m, crossed by four to six others of 35 to 100 m.

    The corridors run around blocks of rooms with a court inside; to come back around the outermost ones takes some
    300 to 600 m. The blocks resemble one another, as they do in hospitals.
    """
    plan = FloorPlan()
    xs = _corridors(int(rng.integers(4, 7)), (28.0, 42.0), rng)
    ys = _corridors(int(rng.integers(2, 4)), (30.0, 45.0), rng)
    for x0, x1 in xs:
        plan.carve(Rectangle(x0, ys[0][0], x1, ys[-1][1]))
    for y0, y1 in ys:
        plan.carve(Rectangle(xs[0][0], y0, xs[-1][1], y1))
    for left, right in pairwise(xs):
        for below, above in pairwise(ys):
            _add_block(plan, Rectangle(left[1], below[1], right[0], above[0]), rng)
    _add_corridor_places(plan, xs, ys)
    return plan


def _corridors(count: int, apart: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """Return where parallel corridors begin and end across [m]."""
    corridors, at = [], 0.0
    for _ in range(count):
        width = float(rng.uniform(2.0, 3.2))
        corridors.append((at, at + width))
        at += width + float(rng.uniform(*apart))
    return corridors


def _add_block(plan: FloorPlan, block: Rectangle, rng: np.random.Generator) -> None:
    """Line the four corridors around a block with rooms that face them."""
    depths = rng.uniform(4.0, 6.5, 4).tolist()
    across = (block.x0 + _WALL, block.x1 - _WALL)
    along = (block.y0 + depths[0] + _WALL, block.y1 - depths[1] - _WALL)
    add_rooms(plan, CorridorSide("north", block.y0), across, depths[0], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("south", block.y1), across, depths[1], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("east", block.x0), along, depths[2], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("west", block.x1), along, depths[3], rng, visited=_VISITED)


def _add_corridor_places(plan: FloorPlan, xs: list[tuple[float, float]], ys: list[tuple[float, float]]) -> None:
    """Name places along the middle of every corridor."""
    for x0, x1 in xs:
        for y in np.arange(ys[0][0] + 1.0, ys[-1][1], _STEP):
            plan.add_place((x0 + x1) / 2.0, float(y))
    for y0, y1 in ys:
        for x in np.arange(xs[0][0] + 1.0, xs[-1][1], _STEP):
            plan.add_place(float(x), (y0 + y1) / 2.0)
