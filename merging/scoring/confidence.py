"""What the score of a place weighs: lengths of wall, pieces and areas that speak for it or against it."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np

from merging.verification.evidence import Evidence
from tbmslam.geometry.se2 import FloatArray


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


def doubtful_m(evidence: Evidence) -> float:
    """Return the length of wall that does not agree."""
    return evidence.compared_wall_m - evidence.agreed_wall_m + evidence.unseen_wall_m


def _beyond_chance(evidence: Evidence) -> float:
    """Return the share of the walls that agrees, less the share that does not: by chance about half of them do."""
    agreed, doubtful = evidence.agreed_wall_m, doubtful_m(evidence)
    return max(agreed - doubtful, 0.0) / (agreed + doubtful + 0.5)


_CHANCE_DOUBTFUL = 0.3
"""So large a share of the walls does not agree at the best false places of self-similar buildings; elsewhere more."""


def _surprise(evidence: Evidence) -> float:
    """Return how unlikely so few doubtful walls are by chance: a length of wall times the information of each metre.

    It grows with the walls, whereas logarithms of lengths hardly tell a large place that fits well from others.
    """
    doubtful = doubtful_m(evidence)
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
"""What the score weighs, in m and m^2. How near the agreeing walls lie is left out: it tells how maps were bent, and
only beside other places of the same two where they belong. Where much overlaps, much agrees by chance."""
_CHANCE = 2
"""So many of the best places may be the truth or symmetrical to it; the next is what chance brings about."""


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


SIGNS = {
    "log of all walls": -1,
    "agreement": 1,
    "log of corners": 1,
    "log of wall seen through": -1,
    "log of misfit over chance": -1,
    "agreement of things beyond chance": 1,
    "log of corners over chance": 1,
    "log of weighed corners over chance": 1,
}
"""What the logit weighs beside the margin, and whether it can only speak for (1) or against (-1) a candidate.

The larger the maps, the more places there are for chance; logarithms of lengths and numbers are of one more. A wall
seen through tells the most: at their true place hardly any two maps have one, and at the best of the false ones most
do. Where walls agree by chance they lie as far apart as chance and the roughness of the walls have it, which the other
places of the same two maps tell. Where what people move agrees, and nowhere else as well, two robots were there in one
hour. A corridor around a block is nearly its own mirror image, and in logarithms hardly more agrees where it lies than
there; so many corners more than anywhere on the mirror image are none of chance all the same. They tell that two maps
show one place, not which: where a corridor has a corner more, it may lie at any of its doors.
"""
FEATURES = tuple(SIGNS)
_LITTLE_M = 0.25
"""So much wall seen through is little [m]."""
_FEW_THINGS_M = 2.0
"""Of things with outlines shorter than this together nobody can say a share [m]."""
_MOST_MISFIT = (0.5, 0.3)
"""Less, and more, than so much, logarithms, is as much."""
_AS_LARGE = 0.7
"""A mirror image with such a share of a place's agreeing wall is as large a coincidence."""
_TOLD_M = 2.0
"""Where less wall than this agrees, how near it lies tells nothing [m]."""
_ENOUGH_CORNERS = 6.0
"""More corners than this make a place no likelier: however many there are, they may be those of equal rooms."""
_COUNTED: Sequence[Callable[[Evidence], float]] = (lambda e: e.pieces.corners, MEASURES["corners beyond chance"].of)
"""What is counted beyond the most that any place of the mirror image has: corners, and such by how well walls agree."""


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
        logits = np.append(features(candidates, decoys) @ self.weights + margins + self.bias, 0.0)
        shares = np.exp(logits - logits.max())
        return np.asarray(shares[:-1] / shares.sum())


_NAMES = {"score": tuple(MEASURES), "weights": FEATURES}


def confidences(candidates: Sequence[Evidence], decoys: Sequence[Evidence]) -> list[float]:
    """Return the probability that each candidate of a pair is where the maps really lie; together 1 at the most."""
    return [float(one) for one in _shipped().probabilities(candidates, decoys)]


def features(candidates: Sequence[Evidence], decoys: Sequence[Evidence]) -> FloatArray:
    """Return the numbers (K, F) of the candidates that the logit weighs, in the order of `FEATURES`."""
    over_chance = [
        math.log1p(max(max(map(of, candidates), default=0.0) - max(map(of, decoys), default=0.0), 0.0))
        for of in _COUNTED
    ]
    rows = [
        [*_features(e, [*candidates[:i], *candidates[i + 1 :]], decoys), *over_chance] for i, e in enumerate(candidates)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, len(FEATURES))


def _features(evidence: Evidence, others: Sequence[Evidence], decoys: Sequence[Evidence]) -> list[float]:
    # Half a metre more than there is: of a few cells of wall nobody can say a share.
    agreement = evidence.agreed_wall_m / (evidence.agreed_wall_m + doubtful_m(evidence) + 0.5)
    corners = math.log1p(min(evidence.pieces.corners, _ENOUGH_CORNERS))
    seen_through = math.log1p(evidence.seen_through_m / _LITTLE_M)
    misfit = min(max(_misfit(evidence, others, decoys), -_MOST_MISFIT[0]), _MOST_MISFIT[1])
    things = _agreement_of_things(evidence) - max(map(_agreement_of_things, [*others, *decoys]), default=0.0)
    return [math.log1p(evidence.larger_wall_m), agreement, corners, seen_through, misfit, things]


def _misfit(evidence: Evidence, others: Sequence[Evidence], decoys: Sequence[Evidence]) -> float:
    """Return the logarithm of how far apart the agreeing walls lie, as many times as by chance.

    By chance it is as at half of the other places, as rough as these maps are and as much as they bent; less where so
    large a part of the mirror image lies nearer.
    """
    here = _told_rmse(evidence)
    elsewhere = [rmse for one in [*others, *decoys] if (rmse := _told_rmse(one)) is not None]
    if here is None or not elsewhere:
        return 0.0
    large = [one for one in decoys if one.agreed_wall_m >= _AS_LARGE * evidence.agreed_wall_m]
    mirrored = [rmse for one in large if (rmse := _told_rmse(one)) is not None]
    return math.log(here / min([float(np.median(elsewhere)), *mirrored]))


def _told_rmse(evidence: Evidence) -> float | None:
    """Return how far apart the agreeing walls lie [m]; None where they are too short to tell."""
    return evidence.rmse_m if evidence.rmse_m and evidence.agreed_wall_m > _TOLD_M else None


def _agreement_of_things(evidence: Evidence) -> float:
    """Return the share of what people move that agrees."""
    return evidence.agreed_things_m / (evidence.compared_things_m + _FEW_THINGS_M)


@cache
def _shipped() -> ConfidenceModel:
    return ConfidenceModel.from_json(
        resources.files("merging").joinpath("confidence_model.json").read_text(encoding="utf-8")
    )
