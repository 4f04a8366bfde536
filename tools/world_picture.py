"""A picture of a simulated world and the ways of its robots."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from datasets.synthetic.robot.simulation import SimulatedRobot
from datasets.synthetic.world.world import World
from tbmslam.io.pictures import Picture

_PIXELS_PER_METRE = 25
_SIXTEENTHS = _PIXELS_PER_METRE * 16  # cv2 draws to 1/16 of a pixel
_WAY_COLOURS = ((200, 90, 0), (0, 150, 60), (40, 40, 220), (190, 0, 190), (0, 150, 200), (120, 120, 0))


def draw_world(world: World, robots: Sequence[SimulatedRobot]) -> Picture:
    """Draw the walls, each robot's way in a colour and its start as a circle."""
    min_x, min_y, max_x, max_y = world.bounds()
    origin = np.array([min_x - 0.5, max_y + 0.5])
    size = (math.ceil((max_y - min_y + 1.0) * _PIXELS_PER_METRE), math.ceil((max_x - min_x + 1.0) * _PIXELS_PER_METRE))
    picture = np.full((*size, 3), 255, dtype=np.uint8)
    walls = np.round((world.walls.reshape(-1, 2, 2) - origin) * [_SIXTEENTHS, -_SIXTEENTHS]).astype(np.int32)
    cv2.polylines(picture, list(walls), isClosed=False, color=(0, 0, 0), thickness=1, lineType=cv2.LINE_AA, shift=4)
    for index, robot in enumerate(robots):
        colour = _WAY_COLOURS[index % len(_WAY_COLOURS)]
        way = np.round((robot.truth.poses[:, :2] - origin) * [_SIXTEENTHS, -_SIXTEENTHS]).astype(np.int32)
        cv2.polylines(picture, [way], isClosed=False, color=colour, thickness=2, lineType=cv2.LINE_AA, shift=4)
        start = (int(way[0, 0]), int(way[0, 1]))
        cv2.circle(picture, start, 8 * 16, colour, thickness=2, lineType=cv2.LINE_AA, shift=4)
    return picture
