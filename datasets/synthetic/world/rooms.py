"""Rooms along a corridor, with walls between them, doors and furniture as a laser 25 cm above the floor sees it."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from tbmslam.geometry.se2 import SE2, FloatArray

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


@dataclass(frozen=True)
class CorridorSide:
    """One wall of a corridor: u runs along it, v away from the corridor into the rooms [m].

    Parameters
    ----------
    direction
        On which side of the corridor the rooms lie.
    line
        The wall's y (north, south) or x (east, west) on the corridor's side [m].
    """

    direction: Literal["north", "south", "east", "west"]
    line: float

    def points(self, uv: FloatArray) -> FloatArray:
        """Carry points (..., 2) from u, v to x, y."""
        u, v = uv[..., 0], uv[..., 1]
        out = self.line + v if self.direction in {"north", "east"} else self.line - v
        return np.stack((u, out) if self.direction in {"north", "south"} else (out, u), axis=-1)

    def rectangle(self, u0: float, v0: float, u1: float, v1: float) -> Rectangle:
        """Return the upright rectangle between two corners."""
        corners = self.points(np.array([[u0, v0], [u1, v1]]))
        return Rectangle(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())


def add_rooms(
    plan: FloorPlan,
    side: CorridorSide,
    extent: tuple[float, float],
    depth: float,
    rng: np.random.Generator,
    corridor: tuple[float, float] = (-math.inf, math.inf),
    visited: float = 1.0,
) -> None:
    """Fill one side of a corridor with furnished rooms.

    Parameters
    ----------
    extent
        Where along the corridor the rooms begin and end, u [m].
    depth
        From the corridor's wall to the rooms' back [m].
    corridor
        Where the corridor begins and ends, when rooms stand beyond its ends: a room that shares too little of it for
        a door is left out.
    visited
        Share of the rooms that are worth a visit.
    """
    wall = float(rng.uniform(0.1, 0.2))
    for start, end in _split(*extent, wall, rng):
        fate = rng.random()
        width = float(rng.uniform(1.02, 1.15))
        first, last = max(start, corridor[0]) + 0.15, min(end, corridor[1]) - 0.15 - width
        if last < first:
            continue
        at = float(rng.uniform(first, last))
        if fate < 0.12:  # a closed door: only its recess shows
            plan.carve(side.rectangle(at, 0.0, at + width, wall * 0.6))
            continue
        room = side.rectangle(start, wall, end, depth - float(rng.uniform(0.0, 0.3)))
        plan.carve(room)
        if fate < 0.25 and last - first > 2.0:  # no door, a wide opening
            width, at = 0.7 * (last - first), first + 0.2 * (last - first)
            add_opening(plan, side, at, width, wall)
        else:
            add_opening(plan, side, at, width, wall)
            _add_leaf(plan, side, at, width, wall, rng)
        furnish(plan, room, rng, density=float(rng.uniform(0.5, 1.3)))
        if visited >= 1.0 or rng.random() < visited:
            plan.add_place(*room.centre)


def add_opening(plan: FloorPlan, side: CorridorSide, at: float, width: float, wall: float) -> None:
    """Break through a wall and keep the way free on both sides."""
    plan.carve(side.rectangle(at, 0.0, at + width, wall))
    plan.keep_clear(side.rectangle(at - 0.1, -1.0, at + width + 0.1, wall + 1.2))


def _add_leaf(
    plan: FloorPlan, side: CorridorSide, at: float, width: float, wall: float, rng: np.random.Generator
) -> None:
    """Hang an open door leaf into the room, hinged at either jamb."""
    angle = math.radians(float(rng.uniform(88.0, 125.0)))
    leaf = np.array([[0.0, 0.0], [width, 0.0], [width, 0.04], [0.0, 0.04]])
    hinged = SE2(0.0, wall, angle).apply(leaf)
    mirror, jamb = (1.0, at) if rng.random() < 0.5 else (-1.0, at + width)
    plan.add_polygon(side.points(hinged * np.array([mirror, 1.0]) + np.array([jamb, 0.0])))


def _split(start: float, end: float, wall: float, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Cut a length into rooms of 2.6 to 6.5 m with walls between them."""
    rooms = []
    while end - start > 9.0:
        width = float(rng.uniform(2.6, 6.0))
        rooms.append((start, start + width))
        start += width + wall
    if end - start > 6.0:
        middle = start + float(rng.uniform(0.42, 0.58)) * (end - start)
        rooms += [(start, middle - wall / 2.0), (middle + wall / 2.0, end)]
    elif end - start > 1.8:
        rooms.append((start, end))
    return rooms
