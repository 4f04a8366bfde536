"""What the score of a place weighs: lengths of wall, pieces and areas that speak for it or against it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
