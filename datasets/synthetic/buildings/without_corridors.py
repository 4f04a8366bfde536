"""Buildings without corridors: open-plan offices, stores, apartments and halls."""

from itertools import combinations

import numpy as np

from datasets.synthetic.world.floor_plan import CorridorSide, FloorPlan, Rectangle, add_rooms, furnish, place_box


def draw_open_plan(rng: np.random.Generator) -> FloorPlan:
    """Draw a room of about 34 x 20 m with cubicles, and meeting rooms to the north."""
    plan = FloorPlan()
    floor = Rectangle(0.0, 0.0, float(rng.uniform(30.0, 38.0)), float(rng.uniform(17.0, 22.0)))
    plan.carve(floor)
    core_width, core_height = float(rng.uniform(5.0, 9.0)), float(rng.uniform(3.0, 5.0))
    core_x = floor.centre[0] + float(rng.uniform(-6.0, 6.0))
    core = Rectangle(core_x - core_width / 2, floor.centre[1] - core_height / 2, core_x + core_width / 2, 0.0)
    core = core._replace(y1=core.y0 + core_height)
    plan.fill(core)
    add_rooms(plan, CorridorSide("north", floor.y1), (floor.x0, floor.x1), float(rng.uniform(3.5, 5.0)), rng)
    _place_cubicles(plan, floor, core, rng)
    for _ in range(8):
        place_box(plan, floor, rng)
    return plan


def _place_cubicles(plan: FloorPlan, floor: Rectangle, core: Rectangle, rng: np.random.Generator) -> None:
    """Place cubicles in blocks, but not on the core. Robots visit the aisles."""
    columns, rows = round((floor.width - 2.0) / 5.5), round((floor.height - 3.0) / 5.0)
    pitch_x, pitch_y = (floor.width - 2.0) / columns, (floor.height - 3.0) / rows
    for i in range(columns):
        for j in range(rows):
            x, y = floor.x0 + 1.8 + i * pitch_x, floor.y0 + 1.8 + j * pitch_y
            block = Rectangle(x, y, x + pitch_x - 1.8, y + pitch_y - 1.8)
            plan.add_place(x - 0.9, y - 0.9)
            if block.grown(0.8).overlaps(core) or rng.random() < 0.08:
                continue
            _place_cross(plan, block, rng)
            furnish(plan, block, rng, density=1.2)


def _place_cross(plan: FloorPlan, block: Rectangle, rng: np.random.Generator) -> None:
    """Place partitions as a cross: four desks back to back, or a screen with side panels."""
    x, y = block.centre
    half = 0.03
    plan.fill(Rectangle(x - half, block.y0, x + half, block.y1))
    if rng.random() < 0.6:
        plan.fill(Rectangle(block.x0, y - half, block.x1, y + half))
    else:
        at = block.y0 if rng.random() < 0.5 else block.y1
        plan.fill(Rectangle(block.x0, at - half, block.x1, at + half))


def draw_store(rng: np.random.Generator) -> FloorPlan:
    """Draw a sales room of about 30 x 20 m with shelves and a storage room behind it."""
    plan = FloorPlan()
    sales = Rectangle(0.0, 0.0, float(rng.uniform(27.0, 34.0)), float(rng.uniform(17.0, 22.0)))
    storage = Rectangle(0.0, sales.y1 + 0.2, sales.x1 * float(rng.uniform(0.5, 0.9)), sales.y1 + 5.0)
    plan.carve(sales)
    plan.carve(storage)
    for fraction in (0.2, 0.75):
        x = storage.x1 * (fraction + float(rng.uniform(-0.1, 0.1)))
        plan.carve(Rectangle(x, sales.y1, x + 1.4, storage.y0))
        plan.keep_clear(Rectangle(x, sales.y1 - 1.2, x + 1.4, storage.y0 + 1.2))
    _place_shelves(plan, sales, rng)
    furnish(plan, sales, rng, density=0.7)
    furnish(plan, storage, rng, density=1.4)
    for _ in range(25):
        place_box(plan, sales, rng)
    plan.add_place(*storage.centre)
    return plan


def _place_shelves(plan: FloorPlan, sales: Rectangle, rng: np.random.Generator) -> None:
    """Place blocks of shelves. Robots visit both ends and the middle of each aisle."""
    x = sales.x0 + 2.2
    while x + 1.1 < sales.x1 - 1.8:
        deep, aisle = float(rng.uniform(0.8, 1.1)), float(rng.uniform(1.7, 2.3))
        y, top = sales.y0 + float(rng.uniform(2.2, 3.5)), sales.y1 - float(rng.uniform(1.8, 2.6))
        plan.add_place(x - aisle / 2.0, sales.y0 + 1.3)
        plan.add_place(x - aisle / 2.0, sales.centre[1])
        plan.add_place(x - aisle / 2.0, sales.y1 - 1.2)
        while top - y > 2.0:
            length = min(float(rng.uniform(3.0, 8.0)), top - y)
            _place_shelf(plan, Rectangle(x, y, x + deep, y + length), rng)
            y += length + float(rng.uniform(1.5, 2.2))
        x += deep + aisle
    for fraction in (0.1, 0.5, 0.9):
        plan.add_place(sales.x1 - 1.2, sales.y0 + fraction * sales.height)


def _place_shelf(plan: FloorPlan, shelf: Rectangle, rng: np.random.Generator) -> None:
    """Place a block of shelves, whose goods make its sides uneven."""
    start = shelf.y0
    while start < shelf.y1 - 0.2:
        end = min(start + float(rng.uniform(0.8, 1.3)), shelf.y1)
        inset = rng.uniform(0.0, 0.12, 2)
        plan.fill(Rectangle(shelf.x0 + float(inset[0]), start, shelf.x1 - float(inset[1]), end))
        if rng.random() < 0.3:  # goods on the floor, on one side only, so that the aisle stays open
            size = rng.uniform(0.25, 0.5, 2).tolist()
            goods = Rectangle(shelf.x1 + 0.03, start, shelf.x1 + 0.03 + size[0], start + size[1])
            plan.try_box(goods, float(rng.normal(0.0, 0.1)))
        start = end


def cut(area: Rectangle, largest: float, wall: float, rng: np.random.Generator) -> list[Rectangle]:
    """Divide an area into rooms that are at most about `largest` metres long and `wall` metres apart."""
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
    """Make openings between neighbours so that every room is connected, and a few more for loops.

    Their width is between the two numbers in `openings` [m].
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
    """Return an opening in the wall between two rooms; None if the common wall is too short."""
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
    """Draw halls of 10 to 20 m, each with another kind of pillars."""
    plan = FloorPlan()
    area = Rectangle(0.0, 0.0, float(rng.uniform(44.0, 56.0)), float(rng.uniform(26.0, 34.0)))
    wall = float(rng.uniform(0.3, 0.5))
    halls = cut(area, 20.0, wall, rng)
    for hall in halls:
        plan.carve(hall)
    join(plan, halls, wall, (1.8, 4.0), rng)
    for hall in halls:
        _place_pillars(plan, hall, rng)
        for _ in range(int(rng.integers(2, 6))):
            place_box(plan, hall, rng)
        _add_places(plan, hall)
    return plan


def _place_pillars(plan: FloorPlan, hall: Rectangle, rng: np.random.Generator) -> None:
    """Place round or square pillars in rows, with small random offsets."""
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
