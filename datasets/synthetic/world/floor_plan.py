"""Drawing a building: rooms are carved out of solid rock, and the rest is wall."""

from typing import NamedTuple

import numpy as np

from datasets.synthetic.world.world import World
from tbmslam.geometry.se2 import SE2, FloatArray


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
        """The middle [m]."""
        return (self.x0 + self.x1) / 2.0, (self.y0 + self.y1) / 2.0

    def grown(self, margin: float) -> "Rectangle":
        """Return it with every side moved outwards."""
        return Rectangle(self.x0 - margin, self.y0 - margin, self.x1 + margin, self.y1 + margin)

    def overlaps(self, other: "Rectangle") -> bool:
        """Return whether the two share area."""
        return self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1


class FloorPlan:
    """A building in the making."""

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
        """Stand a closed polygon (K, 2) [m] in the building, wherever it lies."""
        self._polygons.append(corners)

    def keep_clear(self, rectangle: Rectangle) -> None:
        """Let nothing stand in a rectangle: the way through a door."""
        self._kept_clear.append(rectangle)

    def add_place(self, x: float, y: float) -> None:
        """Name a point worth a visit."""
        self._places.append((x, y))

    def has_room_for(self, thing: Rectangle, margin: float = 0.0) -> bool:
        """Return whether a thing has room, `margin` metres off other things and outside of areas kept clear."""
        grown = thing.grown(margin)
        return not any(grown.overlaps(other) for other in self._things) and not any(
            thing.overlaps(area) for area in self._kept_clear
        )

    def try_box(self, rectangle: Rectangle, turn: float = 0.0, margin: float = 0.0) -> bool:
        """Stand a box there, turned about its middle [rad], if there is room for it; return whether there was."""
        corners = SE2(*rectangle.centre, turn).apply(
            np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [rectangle.width / 2.0, rectangle.height / 2.0]
        )
        around = Rectangle(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
        if not self.has_room_for(around, margin):
            return False
        self._things.append(around)
        self._polygons.append(corners)
        return True

    def try_column(self, x: float, y: float, radius: float, margin: float = 0.0) -> bool:
        """Stand a round thing there, if there is room for it; return whether there was."""
        around = Rectangle(x - radius, y - radius, x + radius, y + radius)
        if not self.has_room_for(around, margin):
            return False
        self._things.append(around)
        self.add_post(x, y, radius)
        return True

    def add_post(self, x: float, y: float, radius: float) -> None:
        """Stand a round thing, a leg perhaps, in the building, wherever it lies."""
        angles = np.arange(12) * (np.pi / 6.0)
        self._polygons.append(np.column_stack((x + radius * np.cos(angles), y + radius * np.sin(angles))))

    def world(self, name: str, seed: int) -> World:
        """Return the finished building, shifted off the lattice on which its measures are round numbers."""
        shift = np.random.default_rng([seed, 77]).uniform(-0.5, 0.5, 2)
        outlines = [np.hstack((corners, np.roll(corners, -1, axis=0))) for corners in self._polygons]
        walls = np.vstack([self._outline(), *outlines]) + np.tile(shift, 2)
        return World(name, seed, walls, np.array(self._places) + shift)

    def _outline(self) -> FloatArray:
        """Return the border (N, 4) between solid and free, in the cells that all rectangles' sides make together."""
        sides = np.round(np.array([rectangle for rectangle, _ in self._strokes]), 6)
        xs, ys = np.unique(sides[:, [0, 2]]), np.unique(sides[:, [1, 3]])
        solid = np.ones((len(xs) + 1, len(ys) + 1), dtype=np.bool_)  # cell (i, j) ends at xs[i], ys[j]
        for (x0, y0, x1, y1), (_, is_solid) in zip(sides, self._strokes, strict=True):
            columns = slice(int(np.searchsorted(xs, x0)) + 1, int(np.searchsorted(xs, x1)) + 1)
            solid[columns, int(np.searchsorted(ys, y0)) + 1 : int(np.searchsorted(ys, y1)) + 1] = is_solid
        upright = [(x, ys[a], x, ys[b]) for x, a, b in _runs(xs, solid[:-1] != solid[1:])]
        level = [(xs[a], y, xs[b], y) for y, a, b in _runs(ys, (solid[:, :-1] != solid[:, 1:]).T)]
        return np.array(upright + level)


def _runs(
    lines: FloatArray, is_border: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
) -> list[tuple[float, int, int]]:
    """Return, line by line, where border cells follow one another: line, index of the first and last cell's end."""
    runs = []
    for line, cells in zip(lines, is_border, strict=True):
        changes = np.flatnonzero(np.diff(cells.astype(np.int8)))
        runs += [(float(line), int(start), int(end)) for start, end in zip(changes[::2], changes[1::2], strict=True)]
    return runs
