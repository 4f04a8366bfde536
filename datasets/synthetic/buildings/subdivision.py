"""Cutting a rectangle into rooms and joining neighbours by openings."""

from itertools import combinations

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle


def cut(area: Rectangle, largest: float, wall: float, rng: np.random.Generator) -> list[Rectangle]:
    """Cut an area into rooms until none is longer than about `largest` metres, `wall` metres apart."""
    longest = max(area.width, area.height)
    if longest < largest * float(rng.uniform(0.85, 1.15)):
        return [area]
    fraction = float(rng.uniform(0.36, 0.64))
    if area.width > area.height:
        middle = area.x0 + fraction * area.width
        parts = (area._replace(x1=middle - wall / 2.0), area._replace(x0=middle + wall / 2.0))
    else:
        middle = area.y0 + fraction * area.height
        parts = (area._replace(y1=middle - wall / 2.0), area._replace(y0=middle + wall / 2.0))
    return [room for part in parts for room in cut(part, largest, wall, rng)]


def join(
    plan: FloorPlan, rooms: list[Rectangle], wall: float, openings: tuple[float, float], rng: np.random.Generator
) -> None:
    """Open the walls between neighbours so that every room is reached, and some more for loops.

    Parameters
    ----------
    openings
        Smallest and largest width of an opening [m].
    """
    group = list(range(len(rooms)))
    pairs = list(combinations(range(len(rooms)), 2))
    rng.shuffle(pairs)
    for first, second in pairs:
        width = float(rng.uniform(*openings))
        opening = _opening(rooms[first], rooms[second], wall, width, rng)
        if opening is None or (group[first] == group[second] and rng.random() > 0.35):
            continue
        group = [group[first] if g == group[second] else g for g in group]
        plan.carve(opening)
        plan.keep_clear(opening.grown(0.7))


def _opening(
    first: Rectangle, second: Rectangle, wall: float, width: float, rng: np.random.Generator
) -> Rectangle | None:
    """Return a way through the wall between two rooms, or None where they share too little of one."""
    x0, x1 = max(first.x0, second.x0), min(first.x1, second.x1)
    y0, y1 = max(first.y0, second.y0), min(first.y1, second.y1)
    if abs(x0 - x1 - wall) < 1e-6 and y1 - y0 > width + 0.2:
        start = float(rng.uniform(y0 + 0.1, y1 - 0.1 - width))
        return Rectangle(x1, start, x0, start + width)
    if abs(y0 - y1 - wall) < 1e-6 and x1 - x0 > width + 0.2:
        start = float(rng.uniform(x0 + 0.1, x1 - 0.1 - width))
        return Rectangle(start, y1, start + width, y0)
    return None
