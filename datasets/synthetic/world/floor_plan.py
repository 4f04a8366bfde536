"""The plan of a building: free rooms and corridors in a solid block, doors and furniture.

Furniture has the outlines that a laser sees about 25 cm above the floor.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from datasets.synthetic.world.world import World
from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray


class Rectangle(NamedTuple):
    """An upright rectangle, x0 < x1 and y0 < y1 [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def width(self) -> float:
        """Extent along x [m]."""
        return self.x1 - self.x0

    @property
    def height(self) -> float:
        """Extent along y [m]."""
        return self.y1 - self.y0

    @property
    def centre(self) -> tuple[float, float]:
        """Centre (x, y) [m]."""
        return (self.x0 + self.x1) / 2.0, (self.y0 + self.y1) / 2.0

    def grown(self, margin: float) -> "Rectangle":
        """Return the rectangle with all sides moved outwards."""
        return Rectangle(self.x0 - margin, self.y0 - margin, self.x1 + margin, self.y1 + margin)

    def overlaps(self, other: "Rectangle") -> bool:
        """Return whether the rectangles overlap."""
        return self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1


class FloorPlan:
    """A building to which walls and furniture are added."""

    def __init__(self) -> None:
        self._strokes: list[tuple[Rectangle, bool]] = []
        self._polygons: list[FloatArray] = []
        self._kept_clear: list[Rectangle] = []
        self._things: list[Rectangle] = []
        self._places: list[tuple[float, float]] = []

    def carve(self, rectangle: Rectangle) -> None:
        """Make a rectangle free."""
        self._strokes.append((rectangle, False))

    def fill(self, rectangle: Rectangle) -> None:
        """Make a rectangle solid."""
        self._strokes.append((rectangle, True))
        self._things.append(rectangle)

    def add_polygon(self, corners: FloatArray) -> None:
        """Add a closed polygon (K, 2) [m] without a check for room."""
        self._polygons.append(corners)

    def keep_clear(self, rectangle: Rectangle) -> None:
        """Keep a rectangle free of furniture, such as the passage of a door."""
        self._kept_clear.append(rectangle)

    def add_place(self, x: float, y: float) -> None:
        """Add a point that robots visit."""
        self._places.append((x, y))

    def has_room_for(self, thing: Rectangle, margin: float = 0.0) -> bool:
        """Return whether a thing fits at a distance `margin` [m] from other things and outside of areas kept clear."""
        grown = thing.grown(margin)
        return not any(grown.overlaps(other) for other in self._things) and not any(
            thing.overlaps(area) for area in self._kept_clear
        )

    def try_box(self, rectangle: Rectangle, turn: float = 0.0, margin: float = 0.0) -> bool:
        """Add a box, rotated about its centre [rad], if there is room; return whether it was added."""
        corners = SE2(*rectangle.centre, turn).apply(
            np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [rectangle.width / 2.0, rectangle.height / 2.0]
        )
        around = Rectangle(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
        if not self.has_room_for(around, margin):
            return False
        self._things.append(around)
        self._polygons.append(corners)
        return True

    def try_column(self, x: float, y: float, radius: float) -> bool:
        """Add a column if there is room; return whether it was added."""
        around = Rectangle(x - radius, y - radius, x + radius, y + radius)
        if not self.has_room_for(around):
            return False
        self._things.append(around)
        self.add_post(x, y, radius)
        return True

    def add_post(self, x: float, y: float, radius: float) -> None:
        """Add a round post, such as a leg, without a check for room."""
        angles = np.arange(12) * (np.pi / 6.0)
        self._polygons.append(np.column_stack((x + radius * np.cos(angles), y + radius * np.sin(angles))))

    def world(self, name: str, seed: int) -> World:
        """Return the finished building, shifted so that its walls do not lie on round numbers."""
        shift = np.random.default_rng([seed, 77]).uniform(-0.5, 0.5, 2)
        outlines = [np.hstack((corners, np.roll(corners, -1, axis=0))) for corners in self._polygons]
        walls = np.vstack([self._outline(), *outlines]) + np.tile(shift, 2)
        return World(name, seed, walls, np.array(self._places) + shift)

    def _outline(self) -> FloatArray:
        """Return the borders (N, 4) between solid and free, on the grid of all sides of rectangles."""
        sides = np.round(np.array([rectangle for rectangle, _ in self._strokes]), 6)
        xs, ys = np.unique(sides[:, [0, 2]]), np.unique(sides[:, [1, 3]])
        solid = np.ones((len(xs) + 1, len(ys) + 1), dtype=np.bool_)  # cell (i, j) ends at xs[i], ys[j]
        for (x0, y0, x1, y1), (_, is_solid) in zip(sides, self._strokes, strict=True):
            columns = slice(int(np.searchsorted(xs, x0)) + 1, int(np.searchsorted(xs, x1)) + 1)
            solid[columns, int(np.searchsorted(ys, y0)) + 1 : int(np.searchsorted(ys, y1)) + 1] = is_solid
        upright = [(x, ys[a], x, ys[b]) for x, a, b in _runs(xs, solid[:-1] != solid[1:])]
        level = [(xs[a], y, xs[b], y) for y, a, b in _runs(ys, (solid[:, :-1] != solid[:, 1:]).T)]
        return np.array(upright + level)


def _runs(lines: FloatArray, is_border: BoolArray) -> list[tuple[float, int, int]]:
    """Return runs of border cells on each line: the line, and the indices where the run begins and ends."""
    runs = []
    for line, cells in zip(lines, is_border, strict=True):
        changes = np.flatnonzero(np.diff(cells.astype(np.int8)))
        runs += [(float(line), int(start), int(end)) for start, end in zip(changes[::2], changes[1::2], strict=True)]
    return runs


TURN = 0.03
"""Standard deviation of the rotation of furniture [rad]."""


def furnish(plan: FloorPlan, room: Rectangle, rng: np.random.Generator, density: float = 1.0) -> None:
    """Place cupboards, desks, chairs and boxes in a room; `density` 1 is a usual office."""
    around = 2.0 * (room.width + room.height)
    for _ in range(round(density * around / 4.0)):
        piece = rng.random()
        if piece < 0.45:
            _place_at_wall(plan, room, rng, rng.uniform(0.6, 1.8), rng.uniform(0.35, 0.6))
        elif piece < 0.9:
            _place_desk(plan, room, rng)
        else:
            place_box(plan, room, rng)
    if min(room.width, room.height) > 3.6 and rng.random() < 0.35 * density:
        _place_table(plan, room, rng)


def place_box(plan: FloorPlan, room: Rectangle, rng: np.random.Generator) -> bool:
    """Try to place a box at a random pose in a room; return whether there was room."""
    size = rng.uniform(0.3, 0.7, 2)
    x, y = rng.uniform(room.x0 + 0.5, room.x1 - 0.5), rng.uniform(room.y0 + 0.5, room.y1 - 0.5)
    box = Rectangle(x - size[0] / 2, y - size[1] / 2, x + size[0] / 2, y + size[1] / 2)
    return plan.try_box(box, rng.uniform(0.0, math.pi), margin=0.9)


def _place_at_wall(plan: FloorPlan, room: Rectangle, rng: np.random.Generator, width: float, depth: float) -> bool:
    """Try to place a cupboard with its back to a wall; return whether there was room."""
    thing = _along_wall(room, rng, width, depth, gap=rng.uniform(0.02, 0.08))
    return thing is not None and plan.try_box(thing, rng.normal(0.0, TURN / 3.0), margin=0.02)


def _place_desk(plan: FloorPlan, room: Rectangle, rng: np.random.Generator) -> None:
    """Try to place a desk at a wall: four legs, drawers under one end, and a chair."""
    desk = _along_wall(room, rng, rng.uniform(1.2, 1.8), 0.8, gap=0.05)
    if desk is None or not plan.has_room_for(desk, margin=0.05):
        return
    drawers = Rectangle(desk.x0 + 0.05, desk.y0 + 0.05, desk.x0 + 0.5, desk.y0 + 0.5)
    plan.try_box(drawers, rng.normal(0.0, TURN))
    _place_legs(plan, desk, 0.03, rng.normal(0.0, TURN))
    middle_x, middle_y = desk.centre
    to_room_x, to_room_y = room.centre[0] - middle_x, room.centre[1] - middle_y
    away = 0.55 / max(math.hypot(to_room_x, to_room_y), 0.1)
    plan.try_column(middle_x + away * to_room_x, middle_y + away * to_room_y, rng.uniform(0.05, 0.2))


def _place_table(plan: FloorPlan, room: Rectangle, rng: np.random.Generator) -> None:
    """Try to place a table with chairs near the centre of a room."""
    x, y = np.array(room.centre) + rng.uniform(-0.5, 0.5, 2)
    length, width = rng.uniform(1.4, 2.4), rng.uniform(0.8, 1.2)
    half_x, half_y = (length / 2, width / 2) if room.width > room.height else (width / 2, length / 2)
    table = Rectangle(x - half_x, y - half_y, x + half_x, y + half_y)
    if not plan.has_room_for(table, margin=0.6):
        return
    _place_legs(plan, table, 0.035, rng.normal(0.0, TURN))
    for side in (-1.0, 1.0):
        for along in (-0.5, 0.5):
            chair = SE2(
                x + along * 2 * half_x * 0.6 + rng.normal(0.0, 0.05), y + side * (half_y + 0.2), rng.uniform(-0.3, 0.3)
            )
            for corner in chair.apply(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])):
                plan.add_post(float(corner[0]), float(corner[1]), 0.015)
    plan.keep_clear(table.grown(0.45))


def _place_legs(plan: FloorPlan, table: Rectangle, radius: float, turn: float) -> None:
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
    """One wall of a corridor: u is along it, v from the corridor into the rooms [m]."""

    direction: Literal["north", "south", "east", "west"]
    """Side of the corridor with the rooms."""
    line: float
    """y (north, south) or x (east, west) of the wall's surface in the corridor [m]."""

    def points(self, uv: FloatArray) -> FloatArray:
        """Return points (..., 2) in u, v as x, y."""
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

    `extent` is the begin and end of the rooms along the corridor [m], and `depth` their size across [m]. If rooms
    extend beyond the `corridor`, those too short for a door to it are left out. Robots visit a share `visited` of the
    rooms.
    """
    wall = float(rng.uniform(0.1, 0.2))
    for start, end in _split(*extent, wall, rng):
        kind = rng.random()
        width = float(rng.uniform(1.02, 1.15))
        first, last = max(start, corridor[0]) + 0.15, min(end, corridor[1]) - 0.15 - width
        if last < first:
            continue
        at = float(rng.uniform(first, last))
        if kind < 0.12:  # a closed door: only its recess is visible
            plan.carve(side.rectangle(at, 0.0, at + width, wall * 0.6))
            continue
        room = side.rectangle(start, wall, end, depth - float(rng.uniform(0.0, 0.3)))
        plan.carve(room)
        if kind < 0.25 and last - first > 2.0:  # no door, a wide opening
            width, at = 0.7 * (last - first), first + 0.2 * (last - first)
            add_opening(plan, side, at, width, wall)
        else:
            add_opening(plan, side, at, width, wall)
            _add_door_leaf(plan, side, at, width, wall, rng)
        furnish(plan, room, rng, density=float(rng.uniform(0.5, 1.3)))
        if visited >= 1.0 or rng.random() < visited:
            plan.add_place(*room.centre)


def add_opening(plan: FloorPlan, side: CorridorSide, at: float, width: float, wall: float) -> None:
    """Make an opening in a wall and keep both sides of it clear."""
    plan.carve(side.rectangle(at, 0.0, at + width, wall))
    plan.keep_clear(side.rectangle(at - 0.1, -1.0, at + width + 0.1, wall + 1.2))


def _add_door_leaf(
    plan: FloorPlan, side: CorridorSide, at: float, width: float, wall: float, rng: np.random.Generator
) -> None:
    """Add an open door leaf in the room, hinged at either jamb."""
    angle = math.radians(float(rng.uniform(88.0, 125.0)))
    leaf = np.array([[0.0, 0.0], [width, 0.0], [width, 0.04], [0.0, 0.04]])
    hinged = SE2(0.0, wall, angle).apply(leaf)
    mirror, jamb = (1.0, at) if rng.random() < 0.5 else (-1.0, at + width)
    plan.add_polygon(side.points(hinged * np.array([mirror, 1.0]) + np.array([jamb, 0.0])))


def _split(start: float, end: float, wall: float, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Divide a length into rooms of 2.6 to 6.5 m with walls between them."""
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
