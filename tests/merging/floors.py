"""Maps of several small floors; of each floor two robots saw overlapping parts."""

import itertools

import numpy as np

from merging.fusion import warp
from tbmslam.belief.grid import GridGeometry
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tests.merging.conftest import draw_rooms, grid_of_occupancy

FLOORS = range(1, 6)


def maps_of_floors(floors=FLOORS):
    """Return the maps by name: of each floor the left part and the right."""
    parts = {"left": (np.s_[:240], SE2(-2.0, 1.0, 0.4)), "right": (np.s_[80:], SE2(3.0, 4.0, -2.0))}
    return {
        f"{floor} {side}": seen(draw_rooms(floor), cols, pose)
        for floor, (side, (cols, pose)) in itertools.product(floors, parts.items())
    }


def seen(floor, cols, T_map_floor):
    """Return the map of the columns of a floor that a robot saw, in the robot's frame."""
    part = np.full_like(floor, -1)
    part[:, cols] = floor[:, cols]
    grid = grid_of_occupancy(part, 0.05)
    return TbmMap(warp(grid, T_map_floor, GridGeometry(0.05, -20.0, -20.0, 800, 800)))
