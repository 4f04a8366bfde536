"""A campus: buildings whose corridors are rings, joined by long passages."""

import itertools
from typing import NamedTuple

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.room_row import CorridorSide, add_rooms

_COLUMNS, _ROWS = 4, 2
_APART = (100.0, 75.0)
"""From the corner of a building to that of the next, along x and y [m]."""
_WALL = 0.2
_VISITED = 0.05
"""Share of the rooms that a robot looks into: the long ways are what makes a campus hard."""
_STEP = 25.0
"""Between places along a corridor [m]."""


class _Ring(NamedTuple):
    """A corridor all around a building, and how wide it is [m]."""

    around: Rectangle
    width: float

    @property
    def inside(self) -> Rectangle:
        """What it runs around."""
        return self.around.grown(-self.width)


def draw_campus(rng: np.random.Generator) -> FloorPlan:
    """Draw eight buildings, each with a corridor of some 200 m around its rooms, and passages between neighbours.

    To come back around all of them takes some 2 km.
    """
    plan = FloorPlan()
    rings = {at: _ring(*at, rng) for at in itertools.product(range(_COLUMNS), range(_ROWS))}
    ways = {at: _way_north(rings[at], rings[at[0], at[1] + 1], rng) for at in rings if (at[0], at[1] + 1) in rings}
    for (column, row), ring in rings.items():
        above, below = ways.get((column, row)), ways.get((column, row - 1))
        _add_building(plan, ring, above, below, rng)
        if (column + 1, row) in rings:
            _add_passage(plan, _way_east(ring, rings[column + 1, row], rng))
    for way in ways.values():
        _add_passage(plan, way)
    return plan


def _ring(column: int, row: int, rng: np.random.Generator) -> _Ring:
    x, y = column * _APART[0], row * _APART[1]
    length, depth = float(rng.uniform(55.0, 72.0)), float(rng.uniform(32.0, 44.0))
    return _Ring(Rectangle(x, y, x + length, y + depth), float(rng.uniform(2.0, 3.0)))


def _way_north(ring: _Ring, other: _Ring, rng: np.random.Generator) -> Rectangle:
    """Return a passage from a building to the one above it."""
    width = float(rng.uniform(2.0, 2.8))
    x = float(rng.uniform(ring.inside.x0 + 8.0, min(ring.inside.x1, other.inside.x1) - 8.0 - width))
    return Rectangle(x, ring.inside.y1, x + width, other.inside.y0)


def _way_east(ring: _Ring, other: _Ring, rng: np.random.Generator) -> Rectangle:
    """Return a passage from a building to the one on its right."""
    width = float(rng.uniform(2.0, 2.8))
    y = float(rng.uniform(ring.inside.y0 + 4.0, min(ring.inside.y1, other.inside.y1) - 4.0 - width))
    return Rectangle(ring.inside.x1, y, other.inside.x0, y + width)


def _add_building(
    plan: FloorPlan, ring: _Ring, above: Rectangle | None, below: Rectangle | None, rng: np.random.Generator
) -> None:
    """Carve a ring; line it with rooms inside, and outside where no passage leaves it."""
    (x0, y0, x1, y1), inner = ring.around, ring.inside
    for corridor in (
        Rectangle(x0, y0, x1, inner.y0),
        Rectangle(x0, inner.y1, x1, y1),
        Rectangle(x0, y0, inner.x0, y1),
        Rectangle(inner.x1, y0, x1, y1),
    ):
        plan.carve(corridor)
        _add_places(plan, corridor)
    depths = rng.uniform(4.0, 6.5, 6).tolist()
    across = (inner.x0 + _WALL, inner.x1 - _WALL)
    along = (inner.y0 + depths[0] + _WALL, inner.y1 - depths[1] - _WALL)
    add_rooms(plan, CorridorSide("north", inner.y0), across, depths[0], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("south", inner.y1), across, depths[1], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("east", inner.x0), along, depths[2], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("west", inner.x1), along, depths[3], rng, visited=_VISITED)
    for side, depth, way in (
        (CorridorSide("north", y1), depths[4], above),
        (CorridorSide("south", y0), depths[5], below),
    ):
        parts = [(x0, x1)] if way is None else [(x0, way.x0 - _WALL), (way.x1 + _WALL, x1)]
        for part in parts:
            add_rooms(plan, side, part, depth, rng, visited=_VISITED)


def _add_passage(plan: FloorPlan, way: Rectangle) -> None:
    plan.carve(way)
    _add_places(plan, way)


def _add_places(plan: FloorPlan, corridor: Rectangle) -> None:
    """Name places along the middle of a corridor."""
    x, y = corridor.centre
    if corridor.width > corridor.height:
        for along in np.arange(corridor.x0 + 1.0, corridor.x1, _STEP):
            plan.add_place(float(along), y)
    else:
        for along in np.arange(corridor.y0 + 1.0, corridor.y1, _STEP):
            plan.add_place(x, float(along))
