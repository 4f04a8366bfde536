"""How far walls can be trusted to stand where they stood: people move small things, and hardly walls."""

import cv2
import numpy as np
import numpy.typing as npt

from merging.config import StructureConfig
from tbmslam.se2 import FloatArray

BoolArray = npt.NDArray[np.bool_]
_Labels = npt.NDArray[np.int32]


def steadiness(walls: BoolArray, surface: BoolArray, resolution: float, config: StructureConfig) -> FloatArray:
    """Return the weights (N,) of surface cells: 1 on pieces of wall that are long, `least_weight` on small things.

    Small things are pieces of wall short in every direction, and solid blocks as short, even where one stands against a
    wall. Turned about, a thing is no longer: what counts is the longer side of the narrowest rectangle around it.

    Parameters
    ----------
    walls, surface
        Which cells (rows, cols) are walls, and which of them are a wall's surface.
    resolution
        Side of a cell [m].
    """
    longest = config.steady_m / resolution
    _, labels, stats, _ = cv2.connectedComponentsWithStats(walls.astype(np.uint8), connectivity=8)
    sizes = _sizes(np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32), longest)
    ramp = (sizes * resolution - config.movable_m) / max(config.steady_m - config.movable_m, resolution)
    weights = np.clip(ramp, config.least_weight, 1.0)[labels[surface]]
    blocks = _blocks(walls, round(config.block_m / resolution), (config.movable_m + config.steady_m) / 2.0 / resolution)
    return np.asarray(np.where(blocks[surface], config.least_weight, weights), dtype=np.float64)


def _blocks(walls: BoolArray, thickness: int, shorter: float) -> BoolArray:
    """Return which cells (rows, cols) belong to solid blocks at least so thick and shorter than given [cells]."""
    square = np.ones((max(thickness, 3),) * 2, np.uint8)
    thick = cv2.morphologyEx(walls.astype(np.uint8), cv2.MORPH_OPEN, square)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(thick, connectivity=8)
    small = _sizes(np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32), shorter) < shorter
    small[0] = False  # what is no block
    # The opening leaves the corners and the rough edge of a turned block out.
    return np.asarray(cv2.dilate(small[labels].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def _sizes(labels: _Labels, stats: _Labels, enough: float) -> FloatArray:
    """Return the longer sides (K,) of components [cells]; for those surely longer than `enough` any number over it."""
    sizes = np.asarray(stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1), dtype=np.float64)
    sizes[0] = np.inf
    for index in np.flatnonzero(sizes <= 1.5 * enough):
        left, top, width, height = stats[index, : cv2.CC_STAT_AREA]
        rows, cols = np.nonzero(labels[top : top + height, left : left + width] == index)
        (_, sides, _) = cv2.minAreaRect(np.column_stack((cols, rows)).astype(np.float32))
        sizes[index] = max(sides) + 1.0
    return sizes
