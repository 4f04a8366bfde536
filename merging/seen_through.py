"""Walls that another robot saw through: not past a thing or a door, but through an unbroken stretch, and beyond."""

import cv2
import numpy as np

from merging.components import Components
from merging.structure import Structure
from tbmslam.se2 import SE2
from tbmslam.walls import see_through

_DOOR_M = 0.8
"""A stretch as long as a door leaf, or as a thing that people move, is none."""


def seen_through_m(target: Structure, source: Structure, T_target_source: SE2, reach_m: float) -> float:
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


def _stretches_m(moving: Structure, fixed: Structure, motion: SE2, reach_m: float) -> float:
    through = see_through(moving.walls, fixed.walls, motion, reach_m) & (moving.weights >= 1.0)
    rows, cols, _ = moving.cells_of(moving.points[through])
    if len(rows) == 0:
        return 0.0
    cells = np.zeros((np.ptp(rows) + 3, np.ptp(cols) + 3), np.uint8)
    cells[rows - rows.min() + 1, cols - cols.min() + 1] = 1
    # Ragged walls have cells with another's front between them.
    pieces = Components.of(cv2.dilate(cells, np.ones((3, 3), np.uint8)) > 0)
    longest = np.hypot(*pieces.sides) * moving.geometry.resolution
    longest[0] = 0.0
    return sum(_longer_m(pieces, int(index), moving.geometry.resolution) for index in np.flatnonzero(longest > _DOOR_M))


def _longer_m(pieces: Components, index: int, resolution: float) -> float:
    """Return how much longer a piece is than a door leaf [m], without the seam of a cell that joined it."""
    _, sides, _ = cv2.minAreaRect(pieces.cells_of(index))
    return max(float(max(sides)) * resolution - resolution - _DOOR_M, 0.0)
