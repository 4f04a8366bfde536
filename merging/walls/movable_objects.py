"""Connected pieces of wall."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from merging.config.registration import StructureConfig
from tbmslam.geometry.se2 import FloatArray

BoolArray = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]


class Components(NamedTuple):
    """Pieces of cells that touch.

    Parameters
    ----------
    labels
        The number of each cell's piece (rows, cols); 0 if there is none.
    stats
        Left, top, width, height and cells (K + 1, 5) of each piece, and of what is none.
    """

    labels: Labels
    stats: Labels

    @classmethod
    def of(cls, cells: BoolArray, *, corners: bool = True) -> "Components":
        """Find the pieces among cells (rows, cols); without `corners` cells that only touch there are apart."""
        connectivity = 8 if corners else 4
        _, labels, stats, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=connectivity)
        return cls(np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32))

    @property
    def sides(self) -> tuple[Labels, Labels]:
        """The widths and the heights (K + 1,) of the pieces [cells]."""
        return self.stats[:, cv2.CC_STAT_WIDTH], self.stats[:, cv2.CC_STAT_HEIGHT]

    def at_least(self, side: float) -> "Components":
        """Return the pieces that are so wide or so high [cells]."""
        kept = np.maximum(*self.sides) >= side
        kept[0] = True
        numbers = np.where(kept, np.cumsum(kept) - 1, 0).astype(np.int32)
        return Components(numbers[self.labels], self.stats[kept])

    def cells_of(self, index: int) -> npt.NDArray[np.float32]:
        """Return the columns and rows (N, 2) of one piece's cells, from its corner."""
        left, top, width, height = self.stats[index, : cv2.CC_STAT_AREA]
        rows, cols = np.nonzero(self.labels[top : top + height, left : left + width] == index)
        return np.column_stack((cols, rows)).astype(np.float32)


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
