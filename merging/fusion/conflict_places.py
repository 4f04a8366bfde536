"""Where the sources of a merged map contradict each other most: a moved door, a change, a bad alignment."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from merging.fusion.fusion import Fusion

_LEAST = 0.1
"""A cell with less conflict belongs to no place; the blur of walls makes a little everywhere."""


@dataclass(frozen=True)
class ConflictPlace:
    """A connected area of contradiction.

    Parameters
    ----------
    x, y
        Its middle, weighed by conflict, in the merged map's frame [m].
    area_m2
        How large it is [m^2].
    conflict_m2
        The conflict in it summed by area [m^2].
    """

    x: float
    y: float
    area_m2: float
    conflict_m2: float


def conflict_places(fusion: Fusion, count: int = 10) -> list[ConflictPlace]:
    """Return the places with the most conflict, the worst first."""
    labels, number = ndimage.label(fusion.conflict >= _LEAST, np.ones((3, 3)))
    if number == 0:
        return []
    rows, cols = np.nonzero(labels)
    place, weight = labels[rows, cols] - 1, fusion.conflict[rows, cols].astype(np.float64)
    sums, cells = np.bincount(place, weight, number), np.bincount(place, minlength=number)
    row, col = np.bincount(place, weight * rows, number) / sums, np.bincount(place, weight * cols, number) / sums
    g = fusion.grid.geometry
    return [
        ConflictPlace(
            *g.centre_of(float(row[k]), float(col[k])),
            float(cells[k] * g.resolution**2),
            float(sums[k] * g.resolution**2),
        )
        for k in np.argsort(-sums, kind="stable")[:count]
    ]
