"""An office floor of about 40 x 25 m: a corridor loop, rooms outside and inside it."""

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.furniture import furnish
from datasets.synthetic.world.room_row import CorridorSide, add_rooms


def draw_office(rng: np.random.Generator) -> FloorPlan:
    """Draw an office; sizes, corridors across the core, rooms and furniture come from `rng`."""
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
    _stand_in_corridors(plan, outer, core, rng)
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
    """Cut up to two corridors across the core; return the blocks (x0, x1) left between them."""
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


def _stand_in_corridors(plan: FloorPlan, outer: Rectangle, core: Rectangle, rng: np.random.Generator) -> None:
    """Stand pilasters, cabinets and plants along the corridors' walls, where no door is."""
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
