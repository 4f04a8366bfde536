"""Places that a pair of maps offers: the one found, and its alternatives."""

import math
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config.map_graph import GraphConfig
from merging.verification.covariance import Covariance, known_best_at
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle

_SURE, _DOUBTFUL = 0.999, 0.85
"""No alignment is believed more than this, and none that was refused."""


@dataclass(frozen=True)
class PoseHypothesis:
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
    covariance
        How exact the place is if it is right; None where nobody knows.
    """

    pair: Pair
    motion: SE2
    odds: float
    wall_m: float
    accepted: bool
    covariance: Covariance | None

    @property
    def probability(self) -> float:
        """How likely it is right."""
        return 1.0 / (1.0 + math.exp(-self.odds))


def hypotheses_of(pair: Pair, found: Alignment, config: GraphConfig) -> list[PoseHypothesis]:
    """Return the places that an alignment of a pair offers: its best, however unlikely, and likely alternatives.

    A refused place that hardly any wall speaks for is none: maps of next to nothing all lie on one another.
    """
    if found.T_target_source is None:
        return []
    confidence = max(found.confidence, 0.9) if found.accepted else min(found.confidence, _DOUBTFUL)
    best = PoseHypothesis(
        pair, found.T_target_source, _log_odds(confidence), found.agreed_wall_m, found.accepted, found.covariance
    )
    others = [
        PoseHypothesis(
            pair,
            one.T_target_source,
            _log_odds(min(one.confidence, _DOUBTFUL)),
            one.agreed_wall_m,
            False,
            one.covariance,
        )
        for one in found.alternatives
        if one.confidence >= config.min_confidence
    ]
    return [one for one in (best, *others) if one.accepted or one.wall_m >= config.min_wall_m]


def worth_of(probability: FloatArray, coincidence: float) -> FloatArray:
    """Return the log odds that a place gains as something else, right with a probability, leads there too.

    Parameters
    ----------
    probability
        How likely what leads there is right (N,); then it leads there for sure.
    coincidence
        How likely it leads there if both it and the place are wrong.
    """
    return np.log1p(probability * (1.0 / coincidence - 1.0))


def _log_odds(confidence: float) -> float:
    p = min(max(confidence, 1.0 - _SURE), _SURE)
    return math.log(p / (1.0 - p))


def is_same_place(motion: SE2, other: SE2, config: GraphConfig, known: Covariance | None = None) -> bool:
    """Tell whether two motions name one place: whether they put a point of the source to one place, and turn it alike.

    The point is that which the covariance of either says is known best, or the origin of the source's frame; this may
    lie far off, where a tenth of a degree is metres.
    """
    point = (0.0, 0.0) if known is None else known_best_at(known)
    turned = abs(wrap_angle(other.theta - motion.theta))
    return math.dist(motion.apply(point), other.apply(point)) <= config.same_m and turned <= config.same_rad
