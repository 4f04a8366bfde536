"""Rooms side by side along a corridor, with walls between them and doors to the corridor."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.furniture import furnish
from tbmslam.geometry.se2 import SE2, FloatArray


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
