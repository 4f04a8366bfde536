"""Buildings of corridors with rooms along them: a bare corridor, wings, an office, a hospital."""

from itertools import pairwise

import numpy as np

from datasets.synthetic.world.floor_plan import CorridorSide, FloorPlan, Rectangle, add_rooms, furnish

PITCH = 4.0
"""Distance between doors [m]."""


def draw_corridor(rng: np.random.Generator) -> FloorPlan:
    """Draw a straight corridor of 60 to 84 m with identical closed doors on opposite sides."""
    plan = FloorPlan()
    doors = int(rng.integers(15, 22))
    width, door, recess = float(rng.uniform(2.0, 2.6)), float(rng.uniform(0.9, 1.0)), float(rng.uniform(0.12, 0.2))
    plan.carve(Rectangle(0.0, 0.0, doors * PITCH, width))
    for index in range(doors):
        middle = (index + 0.5) * PITCH
        plan.carve(Rectangle(middle - door / 2.0, -recess, middle + door / 2.0, width + recess))
        if index % 2 == 0:
            plan.add_place(middle, width / 2.0)
    plan.add_place((doors - 0.3) * PITCH, width / 2.0)
    return plan


def draw_wings(rng: np.random.Generator) -> FloorPlan:
    """Draw a main corridor of about 40 m and one or two wings, all with rooms."""
    plan = FloorPlan()
    length, width = float(rng.uniform(34.0, 44.0)), float(rng.uniform(1.8, 2.6))
    plan.carve(Rectangle(0.0, 0.0, length, width))
    for x in np.arange(2.0, length - 1.0, 6.0):
        plan.add_place(float(x), width / 2.0)
    north = _add_wing(plan, CorridorSide("north", width), length * float(rng.uniform(0.3, 0.7)), rng)
    _add_main_rooms(plan, CorridorSide("north", width), (0.0, *north, length), rng)
    if rng.random() < 0.6:
        south = _add_wing(plan, CorridorSide("south", 0.0), length * float(rng.uniform(0.25, 0.75)), rng)
        _add_main_rooms(plan, CorridorSide("south", 0.0), (0.0, *south, length), rng)
    else:
        add_rooms(plan, CorridorSide("south", 0.0), (0.0, length), float(rng.uniform(4.0, 6.0)), rng)
    return plan


def _add_wing(plan: FloorPlan, side: CorridorSide, middle: float, rng: np.random.Generator) -> tuple[float, float]:
    """Add a wing with rooms on both sides; return its extent along the main corridor."""
    width, length = float(rng.uniform(1.7, 2.3)), float(rng.uniform(12.0, 19.0))
    start, end = middle - width / 2.0, middle + width / 2.0
    corridor = side.rectangle(start, 0.0, end, length)
    plan.carve(corridor)
    for v in np.arange(3.0, length, 6.0):
        x, y = side.points(np.array([middle, v]))
        plan.add_place(float(x), float(y))
    depths = rng.uniform(3.8, 5.5, 2).tolist()
    wall = 0.2  # to the main corridor
    extent = (corridor.y0 + wall, corridor.y1) if side.direction == "north" else (corridor.y0, corridor.y1 - wall)
    add_rooms(plan, CorridorSide("west", start), extent, depths[0], rng)
    add_rooms(plan, CorridorSide("east", end), extent, depths[1], rng)
    return start - depths[0] - 0.2, end + depths[1] + 0.2


def _add_main_rooms(
    plan: FloorPlan, side: CorridorSide, limits: tuple[float, float, float, float], rng: np.random.Generator
) -> None:
    """Add rooms along the main corridor on both sides of a wing."""
    depth = float(rng.uniform(4.0, 6.0))
    for start, end in ((limits[0], limits[1]), (limits[2], limits[3])):
        if end - start > 2.6:
            add_rooms(plan, side, (start, end), depth, rng)


def draw_office(rng: np.random.Generator) -> FloorPlan:
    """Draw an office with random sizes, corridors across the core, rooms and furniture."""
    plan = FloorPlan()
    width, height = float(rng.uniform(37.0, 43.0)), float(rng.uniform(23.0, 27.0))
    south, north, west, east = rng.uniform(4.0, 5.8, 4).tolist()
    outer = Rectangle(west, south, width - east, height - north)
    low, high, left, right = rng.uniform(1.7, 2.4, 4).tolist()
    core = Rectangle(outer.x0 + left, outer.y0 + low, outer.x1 - right, outer.y1 - high)
    _carve_loop(plan, outer, core)
    crossings = _carve_crossings(plan, core, rng)
    add_rooms(plan, CorridorSide("south", outer.y0), (0.0, width), south, rng, (outer.x0, outer.x1))
    add_rooms(plan, CorridorSide("north", outer.y1), (0.0, width), north, rng, (outer.x0, outer.x1))
    add_rooms(plan, CorridorSide("west", outer.x0), (outer.y0, outer.y1), west, rng)
    add_rooms(plan, CorridorSide("east", outer.x1), (outer.y0, outer.y1), east, rng)
    for x0, x1 in crossings:
        _fill_block(plan, Rectangle(x0, core.y0, x1, core.y1), rng)
    _place_in_corridors(plan, outer, core, rng)
    return plan


def _carve_loop(plan: FloorPlan, outer: Rectangle, core: Rectangle) -> None:
    for corridor in (
        Rectangle(outer.x0, outer.y0, outer.x1, core.y0),
        Rectangle(outer.x0, core.y1, outer.x1, outer.y1),
        Rectangle(outer.x0, outer.y0, core.x0, outer.y1),
        Rectangle(core.x1, outer.y0, outer.x1, outer.y1),
    ):
        plan.carve(corridor)
        stretch = max(corridor.width, corridor.height)
        for fraction in (np.arange(round(stretch / 7.0)) + 0.5) / round(stretch / 7.0):
            x, y = corridor.centre
            if corridor.width > corridor.height:
                plan.add_place(corridor.x0 + float(fraction) * corridor.width, y)
            else:
                plan.add_place(x, corridor.y0 + float(fraction) * corridor.height)


def _carve_crossings(plan: FloorPlan, core: Rectangle, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Add up to two corridors across the core; return the blocks (x0, x1) between them."""
    count = int(rng.integers(0, 3))
    blocks, start = [], core.x0
    for index in range(count):
        middle = core.x0 + core.width * (index + 1 + float(rng.uniform(-0.3, 0.3))) / (count + 1)
        half = float(rng.uniform(0.8, 1.2))
        plan.carve(Rectangle(middle - half, core.y0, middle + half, core.y1))
        plan.add_place(middle, core.centre[1])
        blocks.append((start, middle - half))
        start = middle + half
    return [*blocks, (start, core.x1)]


def _fill_block(plan: FloorPlan, block: Rectangle, rng: np.random.Generator) -> None:
    """Fill a block of the core: two rows of rooms back to back, or a lobby open to one corridor."""
    if block.width > 5.0 and rng.random() < 0.25:
        lobby = Rectangle(block.x0 + 0.2, block.y0, block.x1 - 0.2, block.centre[1] + float(rng.uniform(-1.0, 2.0)))
        plan.carve(lobby)
        plan.add_place(*lobby.centre)
        furnish(plan, lobby, rng, density=0.4)
        add_rooms(plan, CorridorSide("south", block.y1), (block.x0 + 0.15, block.x1 - 0.15), block.y1 - lobby.y1, rng)
        return
    middle = block.centre[1] + float(rng.uniform(-0.8, 0.8))
    extent = (block.x0 + 0.15, block.x1 - 0.15)
    add_rooms(plan, CorridorSide("north", block.y0), extent, middle - block.y0 - 0.1, rng)
    add_rooms(plan, CorridorSide("south", block.y1), extent, block.y1 - middle - 0.1, rng)


def _place_in_corridors(plan: FloorPlan, outer: Rectangle, core: Rectangle, rng: np.random.Generator) -> None:
    """Place pilasters, cabinets and plants along the corridors' walls, but not at doors."""
    for _ in range(60):
        deep = float(rng.choice([0.1, 0.2, 0.35]))
        wide = float(rng.uniform(0.3, 0.9))
        along_x = rng.random() < 0.65
        if along_x:
            start = float(rng.uniform(core.x0, core.x1 - wide))
            walls = ((outer.y0, outer.y0 + deep), (core.y0 - deep, core.y0), (core.y1, core.y1 + deep))
            y0, y1 = (*walls, (outer.y1 - deep, outer.y1))[int(rng.integers(4))]
            plan.try_box(Rectangle(start, y0, start + wide, y1), margin=1.5)
        else:
            start = float(rng.uniform(core.y0, core.y1 - wide))
            walls = ((outer.x0, outer.x0 + deep), (core.x0 - deep, core.x0), (core.x1, core.x1 + deep))
            x0, x1 = (*walls, (outer.x1 - deep, outer.x1))[int(rng.integers(4))]
            plan.try_box(Rectangle(x0, start, x1, start + wide), margin=1.5)


_WALL = 0.2
_VISITED = 0.12
"""Share of the rooms that robots visit. The long corridors between them make a large building difficult."""
_STEP = 7.0  # distance between visited places along a corridor [m]


def draw_hospital(rng: np.random.Generator) -> FloorPlan:
    """Draw two or three corridors of 90 to 220 m, and four to six others of 35 to 100 m across them.

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
    """Return begin and end across each of some parallel corridors [m]."""
    corridors, at = [], 0.0
    for _ in range(count):
        width = float(rng.uniform(2.0, 3.2))
        corridors.append((at, at + width))
        at += width + float(rng.uniform(*apart))
    return corridors


def _add_block(plan: FloorPlan, block: Rectangle, rng: np.random.Generator) -> None:
    """Add rooms along the four corridors around a block."""
    depths = rng.uniform(4.0, 6.5, 4).tolist()
    across = (block.x0 + _WALL, block.x1 - _WALL)
    along = (block.y0 + depths[0] + _WALL, block.y1 - depths[1] - _WALL)
    add_rooms(plan, CorridorSide("north", block.y0), across, depths[0], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("south", block.y1), across, depths[1], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("east", block.x0), along, depths[2], rng, visited=_VISITED)
    add_rooms(plan, CorridorSide("west", block.x1), along, depths[3], rng, visited=_VISITED)


def _add_corridor_places(plan: FloorPlan, xs: list[tuple[float, float]], ys: list[tuple[float, float]]) -> None:
    """Add visited places along the centre lines of all corridors."""
    for x0, x1 in xs:
        for y in np.arange(ys[0][0] + 1.0, ys[-1][1], _STEP):
            plan.add_place((x0 + x1) / 2.0, float(y))
    for y0, y1 in ys:
        for x in np.arange(xs[0][0] + 1.0, xs[-1][1], _STEP):
            plan.add_place(float(x), (y0 + y1) / 2.0)
