"""Which keyframes of a long drive may be forgotten, as others show the same."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import FloatArray, path_lengths
from tbmslam.kernels.search.path_lengths import shown_before
from tbmslam.optimisation.pose_graph import MotionEdge


class ForgettingConfig(FrozenConfig):
    """Which keyframes are kept of a drive that visits the same places again and again."""

    PUBLIC: ClassVar = ("limit",)

    limit: int = Field(5000, ge=100, description="number of keyframes from which on redundant ones are dropped")
    enough: int = Field(20, ge=1, description="keyframes of a place that are kept")
    reach: float = Field(1.0, gt=0, description="how near those of one place are [m]")
    turn: float = Field(0.5, gt=0, description="how far those of one place are turned to each other at most [rad]")


_BLOCK = 4.0
"""Travelled length that is kept or forgotten as a whole [m]."""

_FAMILIAR = 0.75
"""Share of a stretch that must have been shown before."""

_BESIDE = 8.0
"""Travelled length before and after what others were laid onto, which is kept [m]."""


def may_be_forgotten(
    poses: FloatArray, closures: Sequence[MotionEdge], first: int, end: int, config: ForgettingConfig
) -> npt.NDArray[np.bool_]:
    """Return which keyframes (K,) may be forgotten: whole stretches, shown before, and laid onto what is kept.

    After a closed loop, in the spirit of G. Kurz et al., "Geometry-based graph pruning for lifelong SLAM", 2021. The
    last of several stretches stays, so that what follows hangs on closures of its own.

    Parameters
    ----------
    poses
        Poses (K, 3) of the laser, corrected.
    closures
        What corrected them.
    first, end
        Keyframes before and from there on are kept.
    config
        How many of a place are kept.
    """
    travelled = path_lengths(poses)
    shown = shown_before(poses, first, config.reach, config.turn, config.enough)
    _, block = np.unique(np.floor((travelled - travelled[first]) / _BLOCK), return_inverse=True)
    familiar = np.bincount(block, shown) >= _FAMILIAR * np.bincount(block)
    laid = np.zeros_like(familiar)
    laid[block[[edge.target for edge in closures]]] = True
    needed = np.arange(len(poses)) >= end
    needed[:first] = True
    for anchor in {edge.source for edge in closures}:
        begin, stop = np.searchsorted(travelled, travelled[anchor] + np.array([-_BESIDE, _BESIDE]))
        needed[begin:stop] = True
    free = familiar & laid & (np.bincount(block, needed) == 0)
    free[:-1] &= free[1:]
    free[-1] = False
    return np.asarray(free[block])
