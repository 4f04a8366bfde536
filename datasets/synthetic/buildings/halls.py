"""Large halls with pillars, joined by wide openings."""

import numpy as np

from datasets.synthetic.buildings.subdivision import cut, join
from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.furniture import stand_box


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
    """Stand pillars in rows, round or square, not quite where the plan says."""
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
