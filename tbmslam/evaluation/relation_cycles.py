"""The error of published relations themselves, estimated from how well their cycles close."""

import itertools
import math
from typing import NamedTuple

import numpy as np

from tbmslam.evaluation.relations import Relations
from tbmslam.geometry.se2 import SE2

_LEAST_CYCLES = 20
"""With fewer cycles the relative standard deviation of the mean exceeds a sixth."""
_EXACT = 1e-4
"""Cycles that close better come from one trajectory and say nothing about its error [m]; files have five decimals."""


class RelationNoise(NamedTuple):
    """Mean errors of the relations that form cycles; they may differ from those of all relations."""

    translation_m: float
    rotation_deg: float
    cycles: int
    """Number of cycles that they were estimated from."""


def relation_noise(relations: Relations) -> RelationNoise | None:
    """Estimate the errors of relations from all cycles of three.

    The errors of three relations add up in a cycle, so its error is the square root of three times as large if they
    are independent. None if there are too few cycles, or if they close exactly.
    """
    motions: dict[float, dict[float, SE2]] = {}
    for (start, end), motion in zip(relations.stamps.tolist(), relations.motions, strict=True):
        forward = SE2.from_array(motion)
        motions.setdefault(start, {})[end] = forward
        motions.setdefault(end, {})[start] = forward.inverse()
    cycles = [
        neighbours[second] @ motions[second][third] @ motions[third][first]
        for first, neighbours in motions.items()
        for second, third in itertools.combinations(sorted(neighbours), 2)
        if first < second and third in motions[second]
    ]
    if len(cycles) < _LEAST_CYCLES:
        return None
    translation = float(np.mean([math.hypot(cycle.x, cycle.y) for cycle in cycles]))
    rotation = math.degrees(float(np.mean([abs(cycle.theta) for cycle in cycles])))
    if translation < _EXACT:
        return None
    return RelationNoise(translation / math.sqrt(3.0), rotation / math.sqrt(3.0), len(cycles))
