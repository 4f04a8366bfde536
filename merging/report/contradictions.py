"""Where maps contradict each other: walls that stand in the midst of another map's free space.

A wall between two cells is in both, and a beam that grazes a wall clears cells of it; neither is a contradiction.
"""

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np

from merging.fusion.warping import offset_in, warp
from merging.merger import Merge
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.map.tbm_map import TbmMap

_ONE_WALL, _ONE_WALL_M = 2, 0.2
"""Walls at most so many cells apart are one, but no farther than so many metres, or a cell where they are coarse: cells
round each by half a cell, and noise moves hits into the next. A door is wider than twice as much."""


def without_rounding(merge: Merge, maps: Mapping[str, TbmMap], reliability: Mapping[str, float]) -> Merge:
    """Return a merge whose conflict is only where another map calls all within two cells of a wall free.

    Where a map ends there it says little: a beam that grazes a wall clears cells of it. What is fused stays as it is. A
    map of reliability 0 neither has walls nor denies any, as it has no part in the conflict either; with any other,
    what is free in a map stays free, and a wall a wall.

    Parameters
    ----------
    merge, maps
        What became of which maps.
    reliability
        Probability that a map, by name, is to be believed; 1 for those not named.
    """
    if merge.fusion is None:
        return merge
    canvas = merge.fusion.grid.geometry
    cells = min(_ONE_WALL, max(1, round(_ONE_WALL_M / canvas.resolution)))
    across = np.arange(-cells, cells + 1)
    reach = (np.hypot(across[:, None], across) <= cells).astype(np.uint8)
    wall, denied = np.zeros((2, canvas.rows, canvas.cols), dtype=np.bool_)
    for name in (name for name in merge.poses if reliability.get(name, 1.0) > 0.0):
        layer = warp(*merge.laid(name, maps), canvas)
        row, col = offset_in(canvas, layer.geometry)
        window = np.s_[row : row + layer.geometry.rows, col : col + layer.geometry.cols]
        walls = layer.masses[..., OCCUPIED] > layer.masses[..., FREE]
        free = layer.masses[..., FREE] > layer.masses[..., OCCUPIED]
        wall[window] |= walls
        within = cv2.erode(free.astype(np.uint8), reach, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        denied[window] |= within > 0
    conflict = np.where(wall & denied, merge.fusion.conflict, np.float32(0.0))
    return replace(merge, fusion=replace(merge.fusion, conflict=conflict))
