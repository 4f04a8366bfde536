"""How likely each candidate is the truth: evidence weighed by a model that was fitted where the truth is known.

A score tells which of two places of one pair has more to say for itself, the logarithm of a likelihood::

    s = sum of weights * log(1 + measure / unit)

The candidates of a pair and "none of them" compete (a conditional logit, McFadden 1974)::

    P(candidate i) = exp(l_i) / (1 + sum over j of exp(l_j)),    l = bias + sum of weights * features + margin

so that two places equally good share the probability, however good they are, and a sum far below 1 says that the maps
show different places. The margin is that of the score over chance: over the best places of the source's mirror image
(`merging.decoys`) and over all but the best places of the source itself. Maps of unlike size, style and
repetitiveness are measured by their own chance in this way. `tools/calibrate_merging.py` fits all weights and writes
`confidence_model.json`.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np

from merging.verification import Evidence
from tbmslam.se2 import FloatArray


@dataclass(frozen=True)
class Measure:
    """Something that the score weighs.

    Parameters
    ----------
    sign
        Whether it can only speak for (1) or against (-1) a place.
    unit
        How much of it is little.
    of
        How much of it there is.
    """

    sign: int
    unit: float
    of: Callable[[Evidence], float]


def _doubtful_m(evidence: Evidence) -> float:
    """Return the length of wall that does not agree."""
    return evidence.compared_wall_m - evidence.agreed_wall_m + evidence.unseen_wall_m


def _beyond_chance(evidence: Evidence) -> float:
    """Return the share of the walls that agrees, less the share that does not: by chance about half of them do."""
    agreed, doubtful = evidence.agreed_wall_m, _doubtful_m(evidence)
    return max(agreed - doubtful, 0.0) / (agreed + doubtful + 0.5)


_CHANCE_DOUBTFUL = 0.3
"""So large a share of the walls does not agree at the best false places of self-similar buildings; elsewhere more."""


def _surprise(evidence: Evidence) -> float:
    """Return how unlikely so few doubtful walls are by chance: a length of wall times the information of each metre.

    It grows with the walls, whereas logarithms of lengths hardly tell a large place that fits well from others.
    """
    doubtful = _doubtful_m(evidence)
    length = evidence.agreed_wall_m + doubtful
    if doubtful >= _CHANCE_DOUBTFUL * length:
        return 0.0
    share = doubtful / length
    for_doubtful = share * math.log(share / _CHANCE_DOUBTFUL) if share > 0.0 else 0.0
    return length * (for_doubtful + (1.0 - share) * math.log((1.0 - share) / (1.0 - _CHANCE_DOUBTFUL)))


MEASURES = {
    "agreeing wall": Measure(1, 1.0, lambda e: e.agreed_wall_m),
    "other wall": Measure(-1, 1.0, lambda e: e.compared_wall_m - e.agreed_wall_m),
    "agreeing pieces": Measure(1, 1.0, lambda e: e.pieces.agreeing),
    "wall against sliding": Measure(1, 1.0, lambda e: e.weakest_wall_m),
    "corners beyond chance": Measure(1, 1.0, lambda e: e.pieces.corners * _beyond_chance(e)),
    "overlap beyond chance": Measure(1, 5.0, lambda e: e.overlap_m2 * _beyond_chance(e)),
    "surprise": Measure(1, 1.0, _surprise),
}
"""What the score weighs, in m and m^2. How near the agreeing walls lie is left out: it tells how maps were bent, not
where they belong. Where much overlaps, much agrees by chance."""

SIGNS = {
    "log of all walls": -1,
    "agreement": 1,
    "log of corners": 1,
    "log of wall seen through": -1,
    "agreement of things": 1,
}
"""What the logit weighs beside the margin, and whether it can only speak for (1) or against (-1) a candidate.

The larger the maps, the more places there are for chance; logarithms are of one plus the number. A wall seen through
tells the most: at their true place hardly any two maps have one, and at the best of the false ones most do. Where what
people move agrees, two robots were there in one hour; where it does not, nothing follows.
"""
FEATURES = tuple(SIGNS)
_CHANCE = 2
"""So many of the best places may be the truth or symmetrical to it; the next is what chance brings about."""
_LITTLE_M = 0.25
"""So much wall seen through is little [m]."""
_FEW_THINGS_M = 2.0
"""Of things with outlines shorter than this together nobody can say a share [m]."""
_ENOUGH_CORNERS = 6.0
"""More corners than this make a place no likelier: however many there are, they may be those of equal rooms."""


@dataclass(frozen=True)
class ConfidenceModel:
    """The weights.

    Parameters
    ----------
    score
        Of `MEASURES` (M,).
    bias, weights
        Of the logit, for `FEATURES` (F,).
    """

    score: FloatArray
    bias: float
    weights: FloatArray

    @classmethod
    def from_json(cls, text: str) -> "ConfidenceModel":
        """Read what `as_json` wrote."""
        found = json.loads(text)
        score, weights = ([float(found[of][name]) for name in names] for of, names in _NAMES.items())
        return cls(np.array(score), float(found["bias"]), np.array(weights))

    def as_json(self) -> str:
        """Return the weights by name, to six digits."""
        rounded = {
            of: {name: round(float(one), 6) for name, one in zip(names, getattr(self, of), strict=True)}
            for of, names in _NAMES.items()
        }
        return json.dumps({**rounded, "bias": round(self.bias, 6)}, indent=2) + "\n"

    def probabilities(self, candidates: Sequence[Evidence], decoys: Sequence[Evidence]) -> FloatArray:
        """Return the probability (K,) of each candidate of a pair; together 1 at the most."""
        own = measured(candidates)
        margins = own @ self.score - by_chance(own, measured(decoys), self.score) @ self.score
        logits = np.append(features(candidates) @ self.weights + margins + self.bias, 0.0)
        shares = np.exp(logits - logits.max())
        return np.asarray(shares[:-1] / shares.sum())


_NAMES = {"score": tuple(MEASURES), "weights": FEATURES}


def confidences(candidates: Sequence[Evidence], decoys: Sequence[Evidence]) -> list[float]:
    """Return the probability that each candidate of a pair is where the maps really lie; together 1 at the most."""
    return [float(one) for one in _shipped().probabilities(candidates, decoys)]


def measured(places: Sequence[Evidence]) -> FloatArray:
    """Return the numbers (K, M) that the score weighs, in the order of `MEASURES`."""
    rows = [[math.log1p(max(one.of(e), 0.0) / one.unit) for one in MEASURES.values()] for e in places]
    return np.array(rows, dtype=np.float64).reshape(-1, len(MEASURES))


def by_chance(candidates: FloatArray, decoys: FloatArray, score: FloatArray) -> FloatArray:
    """Return the measures (M,) of the best that chance achieves in a pair; zeros where it achieves nothing.

    Parameters
    ----------
    candidates, decoys
        Measures (K, M) of the places where the source may lie, and (D, M) of places of its mirror image.
    score
        The score's weights (M,).
    """
    ranked = np.argsort(-(candidates @ score), kind="stable")
    rivals = np.vstack((np.zeros((1, len(MEASURES))), decoys, candidates[ranked[_CHANCE : _CHANCE + 1]]))
    return np.asarray(rivals[int((rivals @ score).argmax())])


def features(candidates: Sequence[Evidence]) -> FloatArray:
    """Return the numbers (K, F) that the logit weighs, in the order of `FEATURES`."""
    return np.array([_features(evidence) for evidence in candidates], dtype=np.float64).reshape(-1, len(FEATURES))


def _features(evidence: Evidence) -> list[float]:
    # Half a metre more than there is: of a few cells of wall nobody can say a share.
    agreement = evidence.agreed_wall_m / (evidence.agreed_wall_m + _doubtful_m(evidence) + 0.5)
    corners = math.log1p(min(evidence.pieces.corners, _ENOUGH_CORNERS))
    seen_through = math.log1p(evidence.seen_through_m / _LITTLE_M)
    things = evidence.agreed_things_m / (evidence.compared_things_m + _FEW_THINGS_M)
    return [math.log1p(evidence.larger_wall_m), agreement, corners, seen_through, things]


@cache
def _shipped() -> ConfidenceModel:
    return ConfidenceModel.from_json(
        resources.files("merging").joinpath("confidence_model.json").read_text(encoding="utf-8")
    )
