"""An open-plan floor: low partitions around a solid core, a row of meeting rooms."""

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle
from datasets.synthetic.world.furniture import furnish, stand_box
from datasets.synthetic.world.room_row import CorridorSide, add_rooms


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
