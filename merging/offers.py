"""Places that a pair of maps offers: the one found, and its alternatives."""

import math
from dataclasses import dataclass

from merging.alignment import Alignment, Pair
from merging.config import GraphConfig
from tbmslam.se2 import SE2, wrap_angle

_SURE, _DOUBTFUL = 0.999, 0.85
"""No alignment is believed more than this, and none that was refused."""


@dataclass(frozen=True)
class Offer:
    """A place that a pair of maps offers.

    Parameters
    ----------
    pair
        The target and the source.
    motion
        T_target_source.
    odds
        Log odds that it is right.
    wall_m
        Agreeing wall [m].
    accepted
        Whether the alignment was.
    """

    pair: Pair
    motion: SE2
    odds: float
    wall_m: float
    accepted: bool


def offers_of(pair: Pair, found: Alignment, config: GraphConfig) -> list[Offer]:
    """Return the places that an alignment of a pair offers: its best, however unlikely, and likely alternatives."""
    if found.T_target_source is None:
        return []
    confidence = max(found.confidence, 0.9) if found.accepted else found.confidence
    places = [(found.T_target_source, confidence, found.agreed_wall_m, found.accepted)]
    likely = (one for one in found.alternatives if one.confidence >= config.min_confidence)
    places += [(one.T_target_source, one.confidence, one.agreed_wall_m, False) for one in likely]
    return [
        Offer(pair, motion, _log_odds(confidence if accepted else min(confidence, _DOUBTFUL)), wall_m, accepted)
        for motion, confidence, wall_m, accepted in places
    ]


def _log_odds(confidence: float) -> float:
    p = min(max(confidence, 1.0 - _SURE), _SURE)
    return math.log(p / (1.0 - p))


def is_same_place(motion: SE2, other: SE2, config: GraphConfig) -> bool:
    """Tell whether two motions name one place."""
    apart = motion.inverse() @ other
    return math.hypot(apart.x, apart.y) <= config.same_m and abs(wrap_angle(apart.theta)) <= config.same_rad
