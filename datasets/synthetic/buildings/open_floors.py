"""Large floors with things that stand on them: an open-plan office, a store."""

import numpy as np

from datasets.synthetic.world.floor_plan import CorridorSide, FloorPlan, Rectangle, add_rooms, furnish, stand_box


def draw_open_plan(rng: np.random.Generator) -> FloorPlan:
    """Draw one room of about 34 x 20 m, cubicles in it, and meeting rooms to the north."""
    plan = FloorPlan()
    floor = Rectangle(0.0, 0.0, float(rng.uniform(30.0, 38.0)), float(rng.uniform(17.0, 22.0)))
    plan.carve(floor)
    core_width, core_height = float(rng.uniform(5.0, 9.0)), float(rng.uniform(3.0, 5.0))
    core_x = floor.centre[0] + float(rng.uniform(-6.0, 6.0))
    core = Rectangle(core_x - core_width / 2, floor.centre[1] - core_height / 2, core_x + core_width / 2, 0.0)
    core = core._replace(y1=core.y0 + core_height)
    plan.fill(core)
    add_rooms(plan, CorridorSide("north", floor.y1), (floor.x0, floor.x1), float(rng.uniform(3.5, 5.0)), rng)
    _stand_cubicles(plan, floor, core, rng)
    for _ in range(8):
        stand_box(plan, floor, rng)
    return plan


def _stand_cubicles(plan: FloorPlan, floor: Rectangle, core: Rectangle, rng: np.random.Generator) -> None:
    """Set cubicles in blocks; where the core is in the way there is none. Aisles are places."""
    columns, rows = round((floor.width - 2.0) / 5.5), round((floor.height - 3.0) / 5.0)
    pitch_x, pitch_y = (floor.width - 2.0) / columns, (floor.height - 3.0) / rows
    for i in range(columns):
        for j in range(rows):
            x, y = floor.x0 + 1.8 + i * pitch_x, floor.y0 + 1.8 + j * pitch_y
            block = Rectangle(x, y, x + pitch_x - 1.8, y + pitch_y - 1.8)
            plan.add_place(x - 0.9, y - 0.9)
            if block.grown(0.8).overlaps(core) or rng.random() < 0.08:
                continue
            _stand_cross(plan, block, rng)
            furnish(plan, block, rng, density=1.2)


def _stand_cross(plan: FloorPlan, block: Rectangle, rng: np.random.Generator) -> None:
    """Stand partitions as a cross: four desks back to back, or one screen with returns."""
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
    _stand_shelves(plan, sales, rng)
    furnish(plan, sales, rng, density=0.7)
    furnish(plan, storage, rng, density=1.4)
    for _ in range(25):
        stand_box(plan, sales, rng)
    plan.add_place(*storage.centre)
    return plan


def _stand_shelves(plan: FloorPlan, sales: Rectangle, rng: np.random.Generator) -> None:
    """Stand blocks of shelves, with places at both ends and in the middle of each aisle."""
    x = sales.x0 + 2.2
    while x + 1.1 < sales.x1 - 1.8:
        deep, aisle = float(rng.uniform(0.8, 1.1)), float(rng.uniform(1.7, 2.3))
        y, top = sales.y0 + float(rng.uniform(2.2, 3.5)), sales.y1 - float(rng.uniform(1.8, 2.6))
        plan.add_place(x - aisle / 2.0, sales.y0 + 1.3)
        plan.add_place(x - aisle / 2.0, sales.centre[1])
        plan.add_place(x - aisle / 2.0, sales.y1 - 1.2)
        while top - y > 2.0:
            length = min(float(rng.uniform(3.0, 8.0)), top - y)
            _stand_shelf(plan, Rectangle(x, y, x + deep, y + length), rng)
            y += length + float(rng.uniform(1.5, 2.2))
        x += deep + aisle
    for fraction in (0.1, 0.5, 0.9):
        plan.add_place(sales.x1 - 1.2, sales.y0 + fraction * sales.height)


def _stand_shelf(plan: FloorPlan, shelf: Rectangle, rng: np.random.Generator) -> None:
    """Stand one block, its sides uneven as goods make them."""
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
