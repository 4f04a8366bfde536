"""Selection of redundant keyframes of a long drive, which may be dropped."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import BoolArray, FloatArray, path_lengths
from tbmslam.kernels.search.path_lengths import revisited
from tbmslam.optimisation.pose_graph import MotionEdge


class ForgettingConfig(FrozenConfig):
    """The keyframes that are kept of a drive with many visits of the same places."""

    PUBLIC: ClassVar = ("limit",)

    limit: int = Field(5000, ge=100, description="number of keyframes from which on redundant ones are dropped")
    enough: int = Field(20, ge=1, description="number of keyframes of a place that are kept")
    reach: float = Field(1.0, gt=0, description="largest distance between keyframes of a place [m]")
    turn: float = Field(0.5, gt=0, description="largest rotation between keyframes of a place [rad]")


_BLOCK = 4.0
"""Travelled length that is kept or forgotten as a whole [m]."""

_FAMILIAR = 0.75
"""Least share of redundant keyframes in a stretch that is forgotten."""

_BESIDE = 8.0
"""Travelled length before and after the earlier end of a closure that is kept [m]."""


def may_be_forgotten(
    poses: FloatArray, closures: Sequence[MotionEdge], first: int, end: int, config: ForgettingConfig
) -> BoolArray:
    """Return which keyframes (K,) may be forgotten: whole stretches that are registered to kept keyframes.

    After a closed loop, in the spirit of G. Kurz et al., "Geometry-based graph pruning for lifelong SLAM", 2021. The
    last of several stretches is kept, so that later keyframes have closures of their own. `poses` (K, 3) are the
    poses of the laser, corrected by `closures`. Keyframes before `first` and from `end` on are kept.
    """
    travelled = path_lengths(poses)
    is_known = revisited(poses, first, config.reach, config.turn, config.enough)
    _, block = np.unique(np.floor((travelled - travelled[first]) / _BLOCK), return_inverse=True)
    familiar = np.bincount(block, is_known) >= _FAMILIAR * np.bincount(block)
    registered = np.zeros_like(familiar)
    registered[block[[edge.target for edge in closures]]] = True
    needed = np.arange(len(poses)) >= end
    needed[:first] = True
    for anchor in {edge.source for edge in closures}:
        begin, stop = np.searchsorted(travelled, travelled[anchor] + np.array([-_BESIDE, _BESIDE]))
        needed[begin:stop] = True
    free = familiar & registered & (np.bincount(block, needed) == 0)
    free[:-1] &= free[1:]
    free[-1] = False
    return np.asarray(free[block])
