"""How likely each candidate is the truth: evidence weighed by a model that was fitted where the truth is known.

The candidates of a pair and "none of them" compete (a conditional logit, McFadden 1974)::

    P(candidate i) = exp(l_i) / (1 + sum over j of exp(l_j)),    l = bias + sum of weights * features

so that two places equally good share the probability, however good they are, and a sum far below 1 says that the maps
show different places. What tells most is the margin over chance: over the best places of the source's mirror image
(`merging.decoys`) and over all but the best places of the source itself. Maps of unlike size, style and repetitiveness
are measured by their own chance in this way. `tools/calibrate_merging.py` fits the weights and writes
`confidence_model.json`.
"""

import json
import math
from collections.abc import Callable, Sequence
from functools import cache
from importlib import resources

import numpy as np

from merging.verification import Evidence
from tbmslam.se2 import FloatArray

SIGNS = {
    "log of larger_wall_m": -1,
    "agreement of steady walls": 1,
    "log of agreeing corners": 1,
    "margin of steady walls": 1,
    "margin of pieces": 1,
    "margin of corners": 1,
}
"""What the model weighs, and whether it can only speak for (1) or against (-1) a candidate.

The larger the maps, the more places there are for chance; logarithms are of one plus the number. Steady walls are what
people do not move: at the true place furniture contradicts and walls do not, at a false one walls do. How near the
agreeing walls lie is left out: it tells how maps were bent, not where they belong."""
FEATURES = tuple(SIGNS)
_CHANCE = 2
"""So many of the best places may be the truth or symmetrical to it; the next is what chance brings about."""
_ENOUGH_CORNERS = 6.0
"""More corners than this make a place no likelier: however many there are, they may be those of equal rooms."""
_LEAST_MARGIN, _MOST_MARGIN = -0.5, 1.2

Measure = Callable[[Evidence], float]


def _walls(evidence: Evidence) -> float:
    """Return the steady wall that agrees [m], less what that costs which does not, unbroken stretches of it twice."""
    others = evidence.steady_compared_m - evidence.steady_agreed_m + evidence.steady_unseen_m
    return evidence.steady_agreed_m - 1.5 * (others + evidence.unbroken_m)


def _pieces(evidence: Evidence) -> float:
    """Return how many pieces agree, less what those cost that do not."""
    pieces = evidence.pieces
    return pieces.agreeing - 0.8 * (pieces.compared - pieces.agreeing)


def _corners(evidence: Evidence) -> float:
    """Return how many corners agree."""
    return evidence.pieces.corners


_MARGINS: tuple[tuple[Measure, float], ...] = ((_walls, 4.0), (_pieces, 3.0), (_corners, 2.0))
"""What is held against chance, and how much of each is too little to tell a ratio."""


def features(candidates: Sequence[Evidence], decoys: Sequence[Evidence]) -> FloatArray:
    """Return the numbers (K, F) that the model weighs, in the order of `FEATURES`, for the candidates of one pair.

    Parameters
    ----------
    candidates
        What speaks for and against the places where the source may lie.
    decoys
        The same for places of its mirror image.
    """
    margins = [_margins(measure, little, candidates, decoys) for measure, little in _MARGINS]
    rows = [[*_features(evidence), *(of[index] for of in margins)] for index, evidence in enumerate(candidates)]
    return np.array(rows, dtype=np.float64).reshape(-1, len(FEATURES))


def _features(evidence: Evidence) -> list[float]:
    looked_at = evidence.steady_compared_m + evidence.steady_unseen_m + 0.5
    return [
        math.log1p(evidence.larger_wall_m),
        evidence.steady_agreed_m / looked_at,
        math.log1p(min(evidence.pieces.corners, _ENOUGH_CORNERS)),
    ]


def _margins(
    measure: Measure, little: float, candidates: Sequence[Evidence], decoys: Sequence[Evidence]
) -> list[float]:
    """Return the logarithm of how many times better than chance each candidate is, within limits."""
    own = [max(measure(evidence), 0.0) for evidence in candidates]
    by_chance = max([0.0, *sorted(own, reverse=True)[_CHANCE : _CHANCE + 1], *map(measure, decoys)])
    ratios = [math.log((value + little) / (by_chance + little)) for value in own]
    return [min(max(ratio, _LEAST_MARGIN), _MOST_MARGIN) for ratio in ratios]


def confidences(candidates: Sequence[Evidence], decoys: Sequence[Evidence]) -> list[float]:
    """Return the probability that each candidate of a pair is where the maps really lie; together 1 at the most."""
    if not candidates:
        return []
    bias, weights = _model()
    logits = features(candidates, decoys) @ weights + bias
    shares = np.exp(np.append(logits, 0.0) - max(float(logits.max()), 0.0))
    return [float(share) for share in shares[:-1] / shares.sum()]


@cache
def _model() -> tuple[float, FloatArray]:
    text = resources.files("merging").joinpath("confidence_model.json").read_text(encoding="utf-8")
    model = json.loads(text)
    return float(model["bias"]), np.array([float(model["weights"][name]) for name in FEATURES])
