"""Separate pieces of wall that agree or contradict: cells of one wall say the same thing, pieces apart do not.

A straight wall lies on many straight walls by chance, and however long it is, that is one coincidence. Walls are
therefore counted by square blocks of the floor too, each of which speaks once, and by the corners among them.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.map.walls import AGREES, CONFLICTS, NOT_SEEN, OUTSIDE, hold
from tbmslam.wall_limits import Limits

_BLOCK_M = 1.0
"""Side of a block."""
_ENOUGH_M = 0.3
"""Less wall than this in a block is a part of a piece."""
_MANY_WALLS = 4000
"""Walls of a map that are enough to judge it by."""


@dataclass(frozen=True)
class Pieces:
    """Numbers of blocks, means of two directions, either map's walls held against the other map.

    Parameters
    ----------
    agreeing, conflicting
        Shares of the walls that agree, and that contradict, summed over the blocks.
    compared
        Blocks with walls where the other map knows something.
    corners
        Blocks in which walls agree that face different ways.
    """

    agreeing: float
    conflicting: float
    compared: float
    corners: float


def count_pieces(target: WallMap, source: WallMap, T_target_source: SE2, limits: Limits) -> Pieces:
    """Count the pieces of wall that speak for and against an alignment."""
    forth = _counts(source, target, T_target_source, limits)
    back = _counts(target, source, T_target_source.inverse(), limits)
    agreeing, conflicting, compared, corners = ((forth + back) / 2.0).tolist()
    return Pieces(agreeing, conflicting, compared, corners)


def _counts(moving: WallMap, fixed: WallMap, motion: SE2, limits: Limits) -> FloatArray:
    some = moving.some(_MANY_WALLS)
    held = hold(moving.walls, some, fixed.walls, motion, limits)
    there = (held != OUTSIDE) & (held != NOT_SEEN)
    if not there.any():
        return np.zeros(4)
    some, held = some[there], held[there]
    cell_m = moving.geometry.resolution * (len(moving.points) / len(there))
    metres = cell_m * moving.weights[some]
    blocks = _blocks(motion.apply(moving.points[some]))
    normals = SE2(0.0, 0.0, motion.theta).apply(moving.normals[some])
    agreed = metres * (held == AGREES)
    xx, xy, yy = (np.bincount(blocks, agreed * normals[:, i] * normals[:, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    weakest = (xx + yy) / 2.0 - np.hypot((xx - yy) / 2.0, xy)
    compared = np.bincount(blocks, metres)
    shares = [
        np.bincount(blocks, part) / np.maximum(compared, _ENOUGH_M) for part in (agreed, metres * (held == CONFLICTS))
    ]
    whole = [np.minimum(part / _ENOUGH_M, 1.0) for part in (compared, weakest)]
    return np.array([part.sum() for part in (*shares, *whole)])


def _blocks(points: FloatArray) -> npt.NDArray[np.int64]:
    """Return the number of the block that each point (N, 2) lies in."""
    cells = np.floor((points - points.min(axis=0)) / _BLOCK_M).astype(np.int64)
    return np.asarray(cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1])
