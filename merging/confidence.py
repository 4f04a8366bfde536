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

FEATURES = (
    "log of agreed_wall_m",
    "log of weakest_wall_m",
    "agreement",
    "conflict",
    "unseen",
    "log of conflicting_wall_m",
    "log of unseen_wall_m",
    "rmse_m",
    "worst_agreement",
    "worst_conflict",
    "log of smaller_wall_m",
    "log of larger_wall_m",
    "log of distinctness",
)
"""What the model weighs; logarithms are of one plus the number. The last is how far a candidate stands out from what
chance brings together in this very pair, see `_distinctness`."""
_ENOUGH = 7
"""Fewer candidates say nothing about chance."""


def features(candidates: Sequence[Evidence]) -> FloatArray:
    """Return the numbers (K, F) that the model weighs, in the order of `FEATURES`, for the candidates of one pair."""
    rows = [_features(evidence) for evidence in candidates]
    return np.column_stack((np.array(rows).reshape(-1, len(FEATURES) - 1), np.log1p(_distinctness(candidates))))


def _features(evidence: Evidence) -> list[float]:
    looked_at = evidence.compared_wall_m + evidence.unseen_wall_m + 0.5
    return [
        math.log1p(evidence.agreed_wall_m),
        math.log1p(evidence.weakest_wall_m),
        evidence.agreed_wall_m / looked_at,
        evidence.conflicting_wall_m / looked_at,
        evidence.unseen_wall_m / looked_at,
        math.log1p(evidence.conflicting_wall_m),
        math.log1p(evidence.unseen_wall_m),
        evidence.rmse_m or 0.0,
        evidence.worst_agreement,
        evidence.worst_conflict,
        math.log1p(evidence.smaller_wall_m),
        math.log1p(evidence.larger_wall_m),
    ]


def _distinctness(candidates: Sequence[Evidence]) -> FloatArray:
    """Return by how many of their spreads each candidate (K,) is better supported than the run of the others.

    Most candidates of a pair are wrong, whatever the pair, so that their supports show what chance does in these maps.
    """
    supports = np.array(
        [e.agreed_wall_m - 1.5 * e.conflicting_wall_m - 0.5 * e.unseen_wall_m for e in candidates], dtype=np.float64
    )
    ranked = np.sort(supports)[::-1]
    usual, spread = 0.0, 1.0
    if len(ranked) >= _ENOUGH:  # the best few may be the truth and its likes
        usual, spread = float(np.median(ranked[4:])), float(ranked[2:].std()) + 0.5
    return np.maximum(supports - usual, 0.0) / spread


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
