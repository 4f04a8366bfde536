"""Apartments and halls: a rectangle cut into rooms, and neighbours joined by openings."""

from itertools import combinations

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle, furnish, stand_box


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
    """Return a way through the wall between two rooms, or None if they share too little of one."""
    x0, x1 = max(first.x0, second.x0), min(first.x1, second.x1)
    y0, y1 = max(first.y0, second.y0), min(first.y1, second.y1)
    if abs(x0 - x1 - wall) < 1e-6 and y1 - y0 > width + 0.2:
        start = float(rng.uniform(y0 + 0.1, y1 - 0.1 - width))
        return Rectangle(x1, start, x0, start + width)
    if abs(y0 - y1 - wall) < 1e-6 and x1 - x0 > width + 0.2:
        start = float(rng.uniform(x0 + 0.1, x1 - 0.1 - width))
        return Rectangle(start, y1, start + width, y0)
    return None


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


def draw_halls(rng: np.random.Generator) -> FloorPlan:
    """Draw halls of 10 to 20 m, each with pillars of its own kind."""
    plan = FloorPlan()
    area = Rectangle(0.0, 0.0, float(rng.uniform(44.0, 56.0)), float(rng.uniform(26.0, 34.0)))
    wall = float(rng.uniform(0.3, 0.5))
    halls = cut(area, 20.0, wall, rng)
    for hall in halls:
        plan.carve(hall)
    join(plan, halls, wall, (1.8, 4.0), rng)
    for hall in halls:
        _stand_pillars(plan, hall, rng)
        for _ in range(int(rng.integers(2, 6))):
            stand_box(plan, hall, rng)
        _add_places(plan, hall)
    return plan


def _stand_pillars(plan: FloorPlan, hall: Rectangle, rng: np.random.Generator) -> None:
    """Stand pillars in rows, round or square, with small errors of their places."""
    size = float(rng.uniform(0.25, 0.45))
    is_round = rng.random() < 0.5
    columns, rows = (max(1, round(length / float(rng.uniform(4.5, 6.5)))) for length in (hall.width, hall.height))
    for i in range(columns):
        for j in range(rows):
            x = hall.x0 + (i + 0.5) * hall.width / columns + float(rng.normal(0.0, 0.03))
            y = hall.y0 + (j + 0.5) * hall.height / rows + float(rng.normal(0.0, 0.03))
            if is_round:
                plan.try_column(x, y, size)
            else:
                plan.try_box(Rectangle(x - size, y - size, x + size, y + size))


def _add_places(plan: FloorPlan, hall: Rectangle) -> None:
    columns, rows = (max(1, round(length / 7.0)) for length in (hall.width, hall.height))
    for i in range(columns):
        for j in range(rows):
            plan.add_place(hall.x0 + (i + 0.5) * hall.width / columns, hall.y0 + (j + 0.5) * hall.height / rows)
