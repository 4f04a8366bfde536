"""How far walls can be trusted to stand where they stood: people move small things, and hardly walls."""

import cv2
import numpy as np
import numpy.typing as npt

from merging.components import Components
from merging.config import StructureConfig
from tbmslam.se2 import FloatArray

BoolArray = npt.NDArray[np.bool_]


def steadiness(
    pieces: Components, walls: BoolArray, surface: BoolArray, resolution: float, config: StructureConfig
) -> FloatArray:
    """Return the weights (N,) of surface cells: 1 on pieces of wall that are long, `least_weight` on small things.

    Small things are pieces of wall short in every direction, and solid blocks as short, even where one stands against a
    wall. Turned about, a thing is no longer: what counts is the longer side of the narrowest rectangle around it.

    Parameters
    ----------
    pieces
        The pieces of wall.
    walls, surface
        Which cells (rows, cols) are walls, and which of them are a wall's surface.
    resolution
        Side of a cell [m].
    """
    longest = config.steady_m / resolution
    sizes = _sizes(pieces, longest)
    ramp = (sizes * resolution - config.movable_m) / max(config.steady_m - config.movable_m, resolution)
    weights = np.clip(ramp, config.least_weight, 1.0)[pieces.labels[surface]]
    blocks = _blocks(walls, round(config.block_m / resolution), (config.movable_m + config.steady_m) / 2.0 / resolution)
    return np.asarray(np.where(blocks[surface], config.least_weight, weights), dtype=np.float64)


def _blocks(walls: BoolArray, thickness: int, shorter: float) -> BoolArray:
    """Return which cells (rows, cols) belong to solid blocks at least so thick and shorter than given [cells]."""
    square = np.ones((max(thickness, 3),) * 2, np.uint8)
    thick = cv2.morphologyEx(walls.astype(np.uint8), cv2.MORPH_OPEN, square)
    blocks = Components.of(thick > 0)
    small = _sizes(blocks, shorter) < shorter
    small[0] = False  # what is no block
    # The opening leaves the corners and the rough edge of a turned block out.
    return np.asarray(cv2.dilate(small[blocks.labels].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def _sizes(pieces: Components, enough: float) -> FloatArray:
    """Return the longer sides (K,) of pieces [cells]; for those surely longer than `enough` any number over it."""
    sizes = np.maximum(*pieces.sides).astype(np.float64)
    sizes[0] = np.inf
    for index in np.flatnonzero(sizes <= 1.5 * enough):
        (_, sides, _) = cv2.minAreaRect(pieces.cells_of(int(index)))
        sizes[index] = max(sides) + 1.0
    return sizes
