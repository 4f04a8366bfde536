"""A stretch of a drive as one piece: surfaces that other scans, of this robot or another, can be laid onto."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tbmslam.se2 import SE2, FloatArray
from tbmslam.surfel_map import SurfelConfig, SurfelMap


@dataclass(frozen=True)
class Submap:
    """Surfaces seen by consecutive keyframes, in the frame of one of them.

    Parameters
    ----------
    anchor
        Index of the keyframe whose laser is the frame.
    first, last
        Indices of the first and the last keyframe in it.
    fine, coarse
        Its surfaces, at the resolution of tracking and at one for searching.
    """

    anchor: int
    first: int
    last: int
    fine: SurfelMap
    coarse: SurfelMap


def build_submap(
    first: int, last: int, poses: FloatArray, points: Sequence[FloatArray], fine: SurfelConfig, coarse: SurfelConfig
) -> Submap:
    """Join the keyframes `first` to `last` (both included).

    Parameters
    ----------
    poses
        Poses (N, 3) of the laser at every keyframe.
    points
        Hits (M, 2) of every keyframe in the laser's frame.
    fine, coarse
        What makes a surface at both resolutions.
    """
    anchor = (first + last) // 2
    T_anchor_map = SE2.from_array(poses[anchor]).inverse()
    maps = SurfelMap(fine), SurfelMap(coarse)
    for index in range(first, last + 1):
        placed = (T_anchor_map @ SE2.from_array(poses[index])).apply(points[index])
        for surfel_map in maps:
            surfel_map.insert(placed)
    return Submap(anchor, first, last, *maps)


def split_into_submaps(poses: FloatArray, length: float) -> list[tuple[int, int]]:
    """Return (first, last) keyframe of stretches of a drive, each `length` metres long and overlapping by half."""
    travelled = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
    count = max(math.ceil(2.0 * travelled[-1] / length) - 1, 1)
    stretches = []
    for number in range(count):
        begin = 0.5 * length * number
        first = int(np.searchsorted(travelled, begin, side="left"))
        last = int(np.searchsorted(travelled, begin + length, side="right")) - 1
        stretches.append((first, max(last, first)))
    return stretches
