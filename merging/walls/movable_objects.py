"""How far walls can be trusted to stand where they stood: people move small things, and hardly walls."""

import cv2
import numpy as np

from merging.config.registration import StructureConfig
from merging.walls.components import BoolArray, Components
from tbmslam.geometry.se2 import FloatArray


def steadiness(
    walls: BoolArray, free: BoolArray, surface: BoolArray, resolution: float, config: StructureConfig
) -> FloatArray:
    """Return the weights (N,) of surface cells: 1 on pieces of wall that are long, `least_weight` on small things.

    Small things are pieces of wall short in every direction, and, even where they stand against a wall, solid blocks as
    short and outlines of what is too small for a room. Turned about, a thing is no longer: what counts is the longer
    side of the narrowest rectangle around it.

    Parameters
    ----------
    walls, free, surface
        Which cells (rows, cols) are walls, which are free, and which walls are a wall's surface.
    resolution
        Side of a cell [m].
    """
    half_gap = max(round(config.gap_m / 2.0 / resolution), 1)
    mended = _grown(walls, half_gap)
    pieces = Components.of(mended)
    sizes = _sizes(pieces, config.steady_m / resolution + 2 * half_gap) - 2 * half_gap
    ramp = (sizes * resolution - config.movable_m) / max(config.steady_m - config.movable_m, resolution)
    weights = np.clip(ramp, config.least_weight, 1.0)[pieces.labels[surface]]
    things = _blocks(walls, resolution, config) | _outlines(mended, free, half_gap, resolution, config)
    return np.asarray(np.where(things[surface], config.least_weight, weights), dtype=np.float64)


def _blocks(walls: BoolArray, resolution: float, config: StructureConfig) -> BoolArray:
    """Return which cells (rows, cols) belong to short solid blocks."""
    square = np.ones((max(round(config.block_m / resolution), 3),) * 2, np.uint8)
    thick = cv2.morphologyEx(walls.astype(np.uint8), cv2.MORPH_OPEN, square)
    blocks = Components.of(thick > 0)
    shorter = (config.movable_m + config.steady_m) / 2.0 / resolution
    small = _sizes(blocks, shorter) < shorter
    small[0] = False  # what is no block
    # The opening leaves the corners and the rough edge of a turned block out.
    return _grown(small[blocks.labels], 1)


def _outlines(
    mended: BoolArray, free: BoolArray, half_gap: int, resolution: float, config: StructureConfig
) -> BoolArray:
    """Return which cells (rows, cols) lie around something too small for a room.

    What is not seen inside may also be a wall between its faces, and must be wider than walls are.
    """
    insides = Components.of(~mended, corners=False)
    widths, heights = (sides + 2 * half_gap for sides in insides.sides)
    seen = np.bincount(insides.labels[free], minlength=len(widths)) > 0.5 * insides.stats[:, cv2.CC_STAT_AREA]
    longest, narrowest = config.thing_m / resolution, np.where(seen, 0.0, config.hollow_m / resolution)
    small = (np.maximum(widths, heights) <= longest) & (np.minimum(widths, heights) >= narrowest)
    small[0] = False  # the walls
    for index in np.flatnonzero(small):
        _, sides, _ = cv2.minAreaRect(insides.cells_of(int(index)))
        small[index] = min(sides) + 1.0 + 2 * half_gap >= narrowest[index]
    return _grown(small[insides.labels], 2 * half_gap + 1)


def _grown(cells: BoolArray, by: int) -> BoolArray:
    """Return the cells (rows, cols) and all that lie so near to one [cells]."""
    return np.asarray(cv2.dilate(cells.astype(np.uint8), np.ones((2 * by + 1,) * 2, np.uint8)) > 0)


def _sizes(pieces: Components, enough: float) -> FloatArray:
    """Return the longer sides (K,) of pieces [cells]; for those surely longer than `enough` any number over it."""
    sizes = np.maximum(*pieces.sides).astype(np.float64)
    sizes[0] = np.inf
    for index in np.flatnonzero(sizes <= 1.5 * enough):
        (_, sides, _) = cv2.minAreaRect(pieces.cells_of(int(index)))
        sizes[index] = max(sides) + 1.0
    return sizes
