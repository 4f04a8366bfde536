"""How likely each candidate is the truth: evidence weighed by a model that was fitted where the truth is known.

The candidates of a pair and "none of them" compete (a conditional logit, McFadden 1974)::

    P(candidate i) = exp(l_i) / (1 + sum over j of exp(l_j)),    l = bias + sum of weights * features

so that two places equally good share the probability, however good they are, and a sum far below 1 says that the maps
show different places. `tools/calibrate_merging.py` fits the weights and writes `confidence_model.json`.
"""

import json
import math
from collections.abc import Sequence
from functools import cache
from importlib import resources

import numpy as np

from merging.verification import Evidence
from tbmslam.se2 import FloatArray

SIGNS = {
    "log of agreed_wall_m": 1,
    "log of weakest_wall_m": 1,
    "agreement": 1,
    "conflict": -1,
    "worst_agreement": 1,
    "worst_conflict": -1,
    "log of smaller_wall_m": 0,
    "log of larger_wall_m": 0,
    "log of distinctness": 1,
    "log of agreeing pieces": 1,
    "share of agreeing pieces": 1,
    "share of conflicting pieces": -1,
    "log of agreeing corners": 1,
    "log of distinctness of pieces": 1,
    "log of distinctness of sure pieces": 1,
}
"""What the model weighs, and whether it can only speak for (1) or against (-1) a candidate; logarithms are of one plus
the number. Distinctness is how far a candidate stands out from what chance brings together in this very pair, see
`_distinctness`. How near the agreeing walls lie is left out: it tells how maps were bent, not where they belong."""
FEATURES = tuple(SIGNS)
_ENOUGH = 7
"""Fewer candidates say nothing about chance."""
_USUAL, _SURE = 0.8, 2.0
"""What a piece that does not agree costs, in pieces that do."""


def features(candidates: Sequence[Evidence]) -> FloatArray:
    """Return the numbers (K, F) that the model weighs, in the order of `FEATURES`, for the candidates of one pair."""
    supports = [e.agreed_wall_m - 1.5 * e.conflicting_wall_m - 0.5 * e.unseen_wall_m for e in candidates]
    columns = [_distinctness(supports)] + [
        _distinctness([_surplus(evidence, cost) for evidence in candidates]) for cost in (_USUAL, _SURE)
    ]
    distinct = np.log1p(np.column_stack(columns)).tolist()
    rows = [_features(evidence, *each) for evidence, each in zip(candidates, distinct, strict=True)]
    return np.array(rows, dtype=np.float64).reshape(-1, len(FEATURES))


def _features(evidence: Evidence, walls: float, usual: float, sure: float) -> list[float]:
    looked_at = evidence.compared_wall_m + evidence.unseen_wall_m + 0.5
    pieces = evidence.pieces
    return [
        math.log1p(evidence.agreed_wall_m),
        math.log1p(evidence.weakest_wall_m),
        evidence.agreed_wall_m / looked_at,
        evidence.conflicting_wall_m / looked_at,
        evidence.worst_agreement,
        evidence.worst_conflict,
        math.log1p(evidence.smaller_wall_m),
        math.log1p(evidence.larger_wall_m),
        walls,
        math.log1p(pieces.agreeing),
        pieces.agreeing / (pieces.compared + 0.5),
        pieces.conflicting / (pieces.compared + 0.5),
        math.log1p(pieces.corners),
        usual,
        sure,
    ]


def _surplus(evidence: Evidence, cost: float) -> float:
    """Return how many pieces agree, less what those cost that do not."""
    pieces = evidence.pieces
    return max(pieces.agreeing - cost * (pieces.compared - pieces.agreeing), 0.0)


def _distinctness(supports: Sequence[float]) -> FloatArray:
    """Return by how many of their spreads each candidate (K,) is better supported than the run of the others.

    Most candidates of a pair are wrong, whatever the pair, so that their supports show what chance does in these maps.
    """
    ranked = np.sort(np.array(supports, dtype=np.float64))[::-1]
    usual, spread = 0.0, 1.0
    if len(ranked) >= _ENOUGH:  # the best few may be the truth and its likes
        usual, spread = float(np.median(ranked[4:])), float(ranked[2:].std()) + 0.5
    return np.asarray(np.maximum(np.array(supports, dtype=np.float64) - usual, 0.0) / spread)


def confidences(candidates: Sequence[Evidence]) -> list[float]:
    """Return the probability that each candidate of a pair is where the maps really lie; together 1 at the most."""
    if not candidates:
        return []
    bias, weights = _model()
    logits = features(candidates) @ weights + bias
    shares = np.exp(np.append(logits, 0.0) - max(float(logits.max()), 0.0))
    return [float(share) for share in shares[:-1] / shares.sum()]


@cache
def _model() -> tuple[float, FloatArray]:
    text = resources.files("merging").joinpath("confidence_model.json").read_text(encoding="utf-8")
    model = json.loads(text)
    return float(model["bias"]), np.array([float(model["weights"][name]) for name in FEATURES])
