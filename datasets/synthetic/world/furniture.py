"""What stands in rooms, as a laser sees it about 25 cm above the floor."""

import math

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from tbmslam.geometry.se2 import SE2

TURN = 0.03
"""Standard deviation of how askew people put things down [rad]."""


def furnish(plan: FloorPlan, room: Rectangle, rng: np.random.Generator, density: float = 1.0) -> None:
    """Stand cupboards, desks, chairs and boxes in a room; `density` 1 is a usual office."""
    around = 2.0 * (room.width + room.height)
    for _ in range(round(density * around / 4.0)):
        piece = rng.random()
        if piece < 0.45:
            _stand_at_wall(plan, room, rng, rng.uniform(0.6, 1.8), rng.uniform(0.35, 0.6))
        elif piece < 0.9:
            _stand_desk(plan, room, rng)
        else:
            stand_box(plan, room, rng)
    if min(room.width, room.height) > 3.6 and rng.random() < 0.35 * density:
        _stand_table(plan, room, rng)


def stand_box(plan: FloorPlan, room: Rectangle, rng: np.random.Generator) -> bool:
    """Try to leave a box somewhere in a room, at any angle; return whether there was room."""
    size = rng.uniform(0.3, 0.7, 2)
    x, y = rng.uniform(room.x0 + 0.5, room.x1 - 0.5), rng.uniform(room.y0 + 0.5, room.y1 - 0.5)
    box = Rectangle(x - size[0] / 2, y - size[1] / 2, x + size[0] / 2, y + size[1] / 2)
    return plan.try_box(box, rng.uniform(0.0, math.pi), margin=0.9)


def _stand_at_wall(plan: FloorPlan, room: Rectangle, rng: np.random.Generator, width: float, depth: float) -> bool:
    """Try to stand a cupboard with its back to a wall; return whether there was room."""
    thing = _along_wall(room, rng, width, depth, gap=rng.uniform(0.02, 0.08))
    return thing is not None and plan.try_box(thing, rng.normal(0.0, TURN / 3.0), margin=0.02)


def _stand_desk(plan: FloorPlan, room: Rectangle, rng: np.random.Generator) -> None:
    """Try to stand a desk at a wall: four legs, drawers under one end, a chair before it."""
    desk = _along_wall(room, rng, rng.uniform(1.2, 1.8), 0.8, gap=0.05)
    if desk is None or not plan.has_room_for(desk, margin=0.05):
        return
    drawers = Rectangle(desk.x0 + 0.05, desk.y0 + 0.05, desk.x0 + 0.5, desk.y0 + 0.5)
    plan.try_box(drawers, rng.normal(0.0, TURN))
    _stand_legs(plan, desk, 0.03, rng.normal(0.0, TURN))
    middle_x, middle_y = desk.centre
    to_room_x, to_room_y = room.centre[0] - middle_x, room.centre[1] - middle_y
    away = 0.55 / max(math.hypot(to_room_x, to_room_y), 0.1)
    plan.try_column(middle_x + away * to_room_x, middle_y + away * to_room_y, rng.uniform(0.05, 0.2))


def _stand_table(plan: FloorPlan, room: Rectangle, rng: np.random.Generator) -> None:
    """Try to stand a table with chairs near the middle of a room."""
    x, y = np.array(room.centre) + rng.uniform(-0.5, 0.5, 2)
    length, width = rng.uniform(1.4, 2.4), rng.uniform(0.8, 1.2)
    half_x, half_y = (length / 2, width / 2) if room.width > room.height else (width / 2, length / 2)
    table = Rectangle(x - half_x, y - half_y, x + half_x, y + half_y)
    if not plan.has_room_for(table, margin=0.6):
        return
    _stand_legs(plan, table, 0.035, rng.normal(0.0, TURN))
    for side in (-1.0, 1.0):
        for along in (-0.5, 0.5):
            chair = SE2(
                x + along * 2 * half_x * 0.6 + rng.normal(0.0, 0.05), y + side * (half_y + 0.2), rng.uniform(-0.3, 0.3)
            )
            for corner in chair.apply(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])):
                plan.add_post(float(corner[0]), float(corner[1]), 0.015)
    plan.keep_clear(table.grown(0.45))


def _stand_legs(plan: FloorPlan, table: Rectangle, radius: float, turn: float) -> None:
    half_x, half_y = table.width / 2.0 - 0.06, table.height / 2.0 - 0.06
    corners = np.array([[-half_x, -half_y], [half_x, -half_y], [half_x, half_y], [-half_x, half_y]])
    for x, y in SE2(*table.centre, turn).apply(corners):
        plan.add_post(float(x), float(y), radius)


def _along_wall(room: Rectangle, rng: np.random.Generator, width: float, depth: float, gap: float) -> Rectangle | None:
    """Return a rectangle with its back to one of the room's walls, or None if the wall is too short."""
    side = int(rng.integers(4))
    low, high = (room.x0, room.x1) if side < 2 else (room.y0, room.y1)
    if high - low < width + 2.0 * gap:
        return None
    start = float(rng.uniform(low + gap, high - gap - width))
    if side == 0:
        return Rectangle(start, room.y0 + gap, start + width, room.y0 + gap + depth)
    if side == 1:
        return Rectangle(start, room.y1 - gap - depth, start + width, room.y1 - gap)
    if side == 2:
        return Rectangle(room.x0 + gap, start, room.x0 + gap + depth, start + width)
    return Rectangle(room.x1 - gap - depth, start, room.x1 - gap, start + width)
