"""A cluttered store: aisles between shelves, displays, a back room."""

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.furniture import furnish, stand_box


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
