"""A long corridor that looks the same everywhere: nothing tells where along it a robot is but its odometry."""

import numpy as np

from datasets.synthetic.world.floor_plan import FloorPlan, Rectangle

PITCH = 4.0
"""Distance from one door to the next [m]."""


def draw_corridor(rng: np.random.Generator) -> FloorPlan:
    """Draw a straight corridor of 60 to 84 m with identical closed doors, opposite one another."""
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
