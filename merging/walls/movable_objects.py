"""Connected components of walls, and the movable objects among them."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from merging.config.registration import StructureConfig
from tbmslam.geometry.se2 import FloatArray

BoolArray = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]


class Components(NamedTuple):
    """Connected components of cells.

    Parameters
    ----------
    labels
        The component of each cell (rows, cols); 0 for the background.
    stats
        Left, top, width, height and number of cells (K + 1, 5) of the background and of each component.
    """

    labels: Labels
    stats: Labels

    @classmethod
    def of(cls, cells: BoolArray, *, corners: bool = True) -> "Components":
        """Find the components of cells (rows, cols); `corners` connects cells that touch at a corner only."""
        connectivity = 8 if corners else 4
        _, labels, stats, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=connectivity)
        return cls(np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32))

    @property
    def sides(self) -> tuple[Labels, Labels]:
        """The widths and the heights (K + 1,) of the components [cells]."""
        return self.stats[:, cv2.CC_STAT_WIDTH], self.stats[:, cv2.CC_STAT_HEIGHT]

    def at_least(self, side: float) -> "Components":
        """Return the components of at least this width or height [cells]."""
        kept = np.maximum(*self.sides) >= side
        kept[0] = True
        numbers = np.where(kept, np.cumsum(kept) - 1, 0).astype(np.int32)
        return Components(numbers[self.labels], self.stats[kept])

    def cells_of(self, index: int) -> npt.NDArray[np.float32]:
        """Return the columns and rows (N, 2) of the cells of a component, relative to its corner."""
        left, top, width, height = self.stats[index, : cv2.CC_STAT_AREA]
        rows, cols = np.nonzero(self.labels[top : top + height, left : left + width] == index)
        return np.column_stack((cols, rows)).astype(np.float32)


def steadiness(
    walls: BoolArray, free: BoolArray, surface: BoolArray, resolution: float, config: StructureConfig
) -> FloatArray:
    """Return the weights (N,) of surface cells: 1 on long walls, `least_weight` on movable objects.

    Movable objects are short components of walls. Short solid blocks, and outlines that are too small for a room, are
    movable objects even if they stand against a wall. The length of an object is the longer side of the smallest
    rectangle around it, so it does not depend on the rotation.

    Parameters
    ----------
    walls, free, surface
        Which cells (rows, cols) are walls, free, and surfaces of walls.
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
    """Return the cells (rows, cols) of short solid blocks."""
    square = np.ones((max(round(config.block_m / resolution), 3),) * 2, np.uint8)
    thick = cv2.morphologyEx(walls.astype(np.uint8), cv2.MORPH_OPEN, square)
    blocks = Components.of(thick > 0)
    shorter = (config.movable_m + config.steady_m) / 2.0 / resolution
    small = _sizes(blocks, shorter) < shorter
    small[0] = False  # the background
    # The opening removes the corners and the rough edge of a rotated block.
    return _grown(small[blocks.labels], 1)


def _outlines(
    mended: BoolArray, free: BoolArray, half_gap: int, resolution: float, config: StructureConfig
) -> BoolArray:
    """Return the cells (rows, cols) of outlines that are too small for a room.

    An unseen inside may be the core of a wall. Therefore it must be wider than walls.
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
    """Return the cells (rows, cols) dilated by a distance [cells]."""
    return np.asarray(cv2.dilate(cells.astype(np.uint8), np.ones((2 * by + 1,) * 2, np.uint8)) > 0)


def _sizes(pieces: Components, enough: float) -> FloatArray:
    """Return the longer sides (K,) of components [cells]; sides over `enough` are not exact."""
    sizes = np.maximum(*pieces.sides).astype(np.float64)
    sizes[0] = np.inf
    for index in np.flatnonzero(sizes <= 1.5 * enough):
        (_, sides, _) = cv2.minAreaRect(pieces.cells_of(int(index)))
        sizes[index] = max(sides) + 1.0
    return sizes
