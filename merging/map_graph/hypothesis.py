"""Pose hypotheses: the pose of a pair's alignment and its alternatives, and the frames in which they are compared."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config.groups import GraphConfig
from merging.verification.covariance import Covariance, known_best_at, seen_from
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


class CentroidFrames:
    """Where the centroids of maps lie in their frames, by what their alignments are about.

    Parameters
    ----------
    offers
        Of pairs of maps, in the frames that the maps have. A map of which none tells keeps its frame.
    """

    def __init__(self, offers: Sequence[PoseHypothesis]) -> None:
        about: dict[str, list[tuple[float, float]]] = {}
        for offer in offers:
            if offer.covariance is not None:
                point = known_best_at(offer.covariance)
                x, y = offer.motion.apply(point)
                about.setdefault(offer.pair[0], []).append((float(x), float(y)))
                about.setdefault(offer.pair[1], []).append(point)
        centroids = {name: np.mean(points, axis=0) for name, points in about.items()}
        self._middles = {name: SE2(float(x), float(y), 0.0) for name, (x, y) in centroids.items()}

    def of(self, name: str) -> SE2:
        """Return the pose of a map's middle in its frame: T_map_middle."""
        return self._middles.get(name, SE2.identity())

    def between(self, offer: PoseHypothesis) -> PoseHypothesis:
        """Return where an offer puts the middle of its source in the frame at the middle of its target."""
        target, source = (self.of(name) for name in offer.pair)
        seen = None if offer.covariance is None else seen_from(offer.covariance, source.inverse())
        return replace(offer, motion=target.inverse() @ offer.motion @ source, covariance=seen)

    def group(self, poses: Mapping[str, SE2]) -> tuple[SE2, dict[str, SE2]]:
        """Return the pose of the first map's middle in a group's frame, and all maps' centroids as seen from there."""
        centroids = {name: pose @ self.of(name) for name, pose in poses.items()}
        first = next(iter(centroids.values()))
        return first, {name: first.inverse() @ pose for name, pose in centroids.items()}

    def maps(self, poses: Mapping[str, SE2]) -> dict[str, SE2]:
        """Return where the maps of a group lie in the first one's frame, of where their centroids lie in any."""
        in_first = {name: pose @ self.of(name).inverse() for name, pose in poses.items()}
        first = next(iter(in_first.values())).inverse()
        return {name: first @ pose for name, pose in in_first.items()}
