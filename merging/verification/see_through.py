"""Walls that another robot saw through: not past a thing or a door, but through an unbroken stretch, and beyond."""

import cv2
import numpy as np
import numpy.typing as npt

from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.search.touching_cells import pieces_of
from tbmslam.map.walls import see_through

Cells = npt.NDArray[np.int64]

_DOOR_M = 0.8
"""A stretch as long as a door leaf, or as a thing that people move, is none."""
_TOUCHING = 3
"""Cells no farther apart along rows and columns touch once both are grown by one."""


def seen_through_m(target: WallMap, source: WallMap, T_target_source: SE2, reach_m: float) -> float:
    """Return the length of unbroken stretches of wall that the other map saw through, a mean of two directions [m].

    Of each only what is longer than a door leaf counts. Places that look alike share many walls, and then one of
    them has a wall where the other's room goes on, which is not much among all walls. A wall of two maps that bent
    stands twice, not so far apart, and nobody sees through both.

    Parameters
    ----------
    reach_m
        So far before and behind the wall the other map knows nothing but free space, farther than maps bend [m].
    """
    forth = _stretches_m(source, target, T_target_source, reach_m)
    return (forth + _stretches_m(target, source, T_target_source.inverse(), reach_m)) / 2.0


def _stretches_m(moving: WallMap, fixed: WallMap, motion: SE2, reach_m: float) -> float:
    through = see_through(moving.walls, fixed.walls, motion, reach_m) & (moving.weights >= 1.0)
    rows, cols, _ = moving.geometry.cells_at(moving.points[through])
    return stretches_m(np.column_stack((rows, cols)), moving.geometry.resolution)


def stretches_m(cells: Cells, resolution: float) -> float:
    """Return by how much the stretches that cells (N, 2) of wall form are longer than a door leaf, together [m].

    Each cell is grown by one all around before: ragged walls have cells with another's front between them.
    """
    if len(cells) == 0:
        return 0.0
    pieces = _large_pieces(cells - cells.min(axis=0), resolution)
    lengths = {_place_of(piece): _longer_m(piece, resolution) for piece in pieces}
    return sum(lengths[place] for place in sorted(lengths))


def _large_pieces(cells: Cells, resolution: float) -> list[Cells]:
    """Return the cells (N, 2) of each piece of those that touch once they are grown; small ones are left out."""
    cells = np.ascontiguousarray(cells[np.lexsort((cells[:, 1], cells[:, 0]))])
    labels = pieces_of(cells, _TOUCHING)
    order = np.argsort(labels, kind="stable")
    cells, starts = cells[order], np.flatnonzero(np.diff(labels[order], prepend=-1))
    sides = np.maximum.reduceat(cells, starts) - np.minimum.reduceat(cells, starts) + 3  # grown
    large = np.hypot(*sides.T) * resolution > _DOOR_M
    return [piece for piece, is_large in zip(np.split(cells, starts[1:]), large, strict=True) if is_large]


def _place_of(piece: Cells) -> tuple[int, int]:
    """Return which square of two by two cells a grown piece begins in: sums of lengths are taken in this order."""
    row = int(piece[:, 0].min()) // 2
    return row, int(piece[piece[:, 0] <= 2 * row + 1, 1].min()) // 2


def _longer_m(piece: Cells, resolution: float) -> float:
    """Return how much longer a piece is than a door leaf [m], without the seam of a cell that joined it."""
    rows, cols = (piece - piece.min(axis=0)).T + 1
    grown = np.zeros((rows.max() + 2, cols.max() + 2), dtype=np.uint8)
    grown[rows, cols] = 1
    _, sides, _ = cv2.minAreaRect(cv2.findNonZero(cv2.dilate(grown, np.ones((3, 3), np.uint8))).astype(np.float32))
    return max(float(max(sides)) * resolution - resolution - _DOOR_M, 0.0)
