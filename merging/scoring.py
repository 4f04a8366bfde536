"""The probability of each pose hypothesis of two maps: a conditional logit of their evidence.

The reference is chance, estimated from decoys: the source's mirror image is registered to the target as well. It has
the same walls, rooms and repetitions, but no true pose except in symmetrical buildings. A true pose fits better than
the best pose of the mirror image; a false pose does not. This is the target-decoy search of J. Elias and S. Gygi,
Nature Methods 4, 2007.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from merging.config import MergeConfig
from merging.registration.correlation import find_candidates
from merging.verification import Evidence
from merging.walls import WallMap
from tbmslam.geometry.se2 import FloatArray


@dataclass(frozen=True)
class Measure:
    """A feature of the score, used as log(1 + value / unit)."""

    sign: int
    """Sign of its weight: whether it supports (1) or contradicts (-1) a hypothesis."""
    unit: float
    """A small value."""
    of: Callable[[Evidence], float]
    """Its value."""


def doubtful_m(evidence: Evidence) -> float:
    """Return the length of wall that does not agree."""
    return evidence.compared_wall_m - evidence.agreed_wall_m + evidence.unseen_wall_m


def _beyond_chance(evidence: Evidence) -> float:
    """Return the share of agreeing walls minus the share of all others; by chance about half of the walls agree."""
    agreed, doubtful = evidence.agreed_wall_m, doubtful_m(evidence)
    return max(agreed - doubtful, 0.0) / (agreed + doubtful + 0.5)


_CHANCE_DOUBTFUL = 0.3
"""Share of walls that do not agree at the best false poses in self-similar buildings; it is larger elsewhere."""


def _surprise(evidence: Evidence) -> float:
    """Return the length of wall times the Kullback-Leibler divergence of its doubtful share from that by chance [m].

    It grows with the length of the walls, and so distinguishes large maps that fit well, which logarithms of lengths
    hardly do.
    """
    doubtful = doubtful_m(evidence)
    length = evidence.agreed_wall_m + doubtful
    if doubtful >= _CHANCE_DOUBTFUL * length:
        return 0.0
    share = doubtful / length
    of_doubtful = share * math.log(share / _CHANCE_DOUBTFUL) if share > 0.0 else 0.0
    return length * (of_doubtful + (1.0 - share) * math.log((1.0 - share) / (1.0 - _CHANCE_DOUBTFUL)))


MEASURES = {
    "agreeing wall": Measure(1, 1.0, lambda e: e.agreed_wall_m),
    "other wall": Measure(-1, 1.0, lambda e: e.compared_wall_m - e.agreed_wall_m),
    "agreeing pieces": Measure(1, 1.0, lambda e: e.pieces.agreeing),
    "wall against sliding": Measure(1, 1.0, lambda e: e.weakest_wall_m),
    "corners beyond chance": Measure(1, 1.0, lambda e: e.pieces.corners * _beyond_chance(e)),
    "overlap beyond chance": Measure(1, 5.0, lambda e: e.overlap_m2 * _beyond_chance(e)),
    "surprise": Measure(1, 1.0, _surprise),
}
"""The features of the score, in m and m^2. The distance of the agreeing walls is not among them: it depends on the
distortion of the maps, and is informative only relative to other poses of the same maps."""
_CHANCE = 2
"""Number of best hypotheses that may be the truth or symmetrical to it; the next one is chance."""


def measured(places: Sequence[Evidence]) -> FloatArray:
    """Return the features (K, M) of the score, in the order of `MEASURES`."""
    rows = [[math.log1p(max(measure.of(e), 0.0) / measure.unit) for measure in MEASURES.values()] for e in places]
    return np.array(rows, dtype=np.float64).reshape(-1, len(MEASURES))


def by_chance(candidates: FloatArray, decoys: FloatArray, score: FloatArray) -> FloatArray:
    """Return the measures (M,) of the best pose by chance: of a decoy, or of a hypothesis that cannot be the truth.

    `candidates` (K, M) are measures of the hypotheses, `decoys` (D, M) those of the decoys, and `score` (M,) the
    weights.
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
"""The features of the logit beside the margin of the score over chance, with the signs of their weights.

- Walls: larger maps have more poses at which walls agree by chance. Logarithms are of the value plus one.
- Wall seen through: the strongest feature. Nearly no true pose has such walls, and most of the best false ones do.
- Misfit over chance: walls that agree by chance are as far apart as at other poses of the same maps.
- Things beyond chance: movable objects that agree only at this pose show that both visits were within an hour.
- Corners over chance: a corridor around a block nearly equals its mirror image, but the number of corners differs. It
  shows that two maps have a place in common, but not which one.
"""
FEATURES = tuple(SIGNS)
_LITTLE_M = 0.25
"""A small length of wall seen through [m]."""
_FEW_THINGS_M = 2.0
"""Length of the outlines of movable objects that is too short for a share [m]."""
_MOST_MISFIT = (0.5, 0.3)
"""Limits below and above zero of the log of the misfit."""
_AS_LARGE = 0.7
"""Least agreeing wall of a comparable decoy, as a share of the hypothesis's."""
_MEANINGFUL_M = 2.0
"""Least agreeing wall for a meaningful RMS distance [m]."""
_ENOUGH_CORNERS = 6.0
"""Number of corners that counts at most: more may belong to equal rooms."""
_COUNTED: Sequence[Callable[[Evidence], float]] = (lambda e: e.pieces.corners, MEASURES["corners beyond chance"].of)
"""Numbers that are compared with the largest of any decoy: corners, and corners weighted by agreement."""


@dataclass(frozen=True)
class ConfidenceModel:
    """The weights of the model."""

    score: FloatArray
    """Weights (M,) of `MEASURES`."""
    bias: float
    weights: FloatArray
    """Bias of the logit, and its weights (F,) of `FEATURES`."""

    @classmethod
    def from_json(cls, text: str) -> "ConfidenceModel":
        """Read the text of `as_json`."""
        found = json.loads(text)
        score, weights = ([float(found[of][name]) for name in names] for of, names in _NAMES.items())
        return cls(np.array(score), float(found["bias"]), np.array(weights))

    def as_json(self) -> str:
        """Return the weights by name, to six digits."""
        rounded = {
            of: {name: round(float(weight), 6) for name, weight in zip(names, getattr(self, of), strict=True)}
            for of, names in _NAMES.items()
        }
        return json.dumps({**rounded, "bias": round(self.bias, 6)}, indent=2) + "\n"

    def probabilities(
        self, candidates: Sequence[Evidence], decoys: Sequence[Evidence], *, deformed: bool = False
    ) -> FloatArray:
        """Return the probability (K,) of each candidate; their sum is at most 1.

        Walls that the other robot saw through count against a candidate. If maps were `deformed`, they count against
        decoys, too: deformed decoys of a nearly symmetrical building fit well, but for these walls.
        """
        logits = np.append(self.logits(candidates, decoys, deformed=deformed), 0.0)
        shares = np.exp(logits - logits.max())
        return np.asarray(shares[:-1] / shares.sum())

    def logits(
        self, candidates: Sequence[Evidence], decoys: Sequence[Evidence], *, deformed: bool = False
    ) -> FloatArray:
        """Return the log odds (K,) of each candidate against chance; see `probabilities`."""
        own = measured(candidates)
        if deformed:
            margins = own @ self.score - self._chance_of_deformed(candidates, own, decoys)
        else:
            margins = own @ self.score - by_chance(own, measured(decoys), self.score) @ self.score
        return np.asarray(features(candidates, decoys) @ self.weights + margins + self.bias)

    def _chance_of_deformed(self, candidates: Sequence[Evidence], own: FloatArray, decoys: Sequence[Evidence]) -> float:
        """Return the score of the best pose by chance, as `by_chance`, less the weight of its walls seen through."""
        ranked = np.argsort(-(own @ self.score), kind="stable")
        rivals = [*decoys, *(candidates[index] for index in ranked[_CHANCE : _CHANCE + 1])]
        against = float(self.weights[FEATURES.index("log of wall seen through")])
        contradicted = against * np.array([_log_seen_through(rival) for rival in rivals])
        return float(np.max(measured(rivals) @ self.score + contradicted, initial=0.0))


_NAMES = {"score": tuple(MEASURES), "weights": FEATURES}


def confidences(candidates: Sequence[Evidence], decoys: Sequence[Evidence], *, deformed: bool = False) -> list[float]:
    """Return the probability of each candidate by the shipped model; see `ConfidenceModel.probabilities`."""
    return [float(p) for p in _shipped().probabilities(candidates, decoys, deformed=deformed)]


def log_odds(evidence: Evidence, decoys: Sequence[Evidence]) -> float:
    """Return the log odds of one pose against chance; unlike its probability they never saturate."""
    return float(_shipped().logits([evidence], decoys)[0])


def features(candidates: Sequence[Evidence], decoys: Sequence[Evidence]) -> FloatArray:
    """Return the features (K, F) of the candidates, in the order of `FEATURES`."""
    over_chance = [
        math.log1p(max(max(map(of, candidates), default=0.0) - max(map(of, decoys), default=0.0), 0.0))
        for of in _COUNTED
    ]
    rows = [
        [*_features(e, [*candidates[:i], *candidates[i + 1 :]], decoys), *over_chance] for i, e in enumerate(candidates)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, len(FEATURES))


def _features(evidence: Evidence, others: Sequence[Evidence], decoys: Sequence[Evidence]) -> list[float]:
    # The half metre reduces the share of a few cells of wall.
    agreement = evidence.agreed_wall_m / (evidence.agreed_wall_m + doubtful_m(evidence) + 0.5)
    corners = math.log1p(min(evidence.pieces.corners, _ENOUGH_CORNERS))
    seen_through = _log_seen_through(evidence)
    misfit = min(max(_misfit(evidence, others, decoys), -_MOST_MISFIT[0]), _MOST_MISFIT[1])
    things = _agreement_of_things(evidence) - max(map(_agreement_of_things, [*others, *decoys]), default=0.0)
    return [math.log1p(evidence.larger_wall_m), agreement, corners, seen_through, misfit, things]


def _log_seen_through(evidence: Evidence) -> float:
    return math.log1p(evidence.seen_through_m / _LITTLE_M)


def _misfit(evidence: Evidence, others: Sequence[Evidence], decoys: Sequence[Evidence]) -> float:
    """Return the log of the RMS distance of the agreeing walls relative to chance.

    Chance is the median of the other poses of these maps, or of a decoy with as much agreeing wall if that is less.
    """
    here = _meaningful_rmse(evidence)
    elsewhere = [rmse for other in [*others, *decoys] if (rmse := _meaningful_rmse(other)) is not None]
    if here is None or not elsewhere:
        return 0.0
    large = [decoy for decoy in decoys if decoy.agreed_wall_m >= _AS_LARGE * evidence.agreed_wall_m]
    mirrored = [rmse for decoy in large if (rmse := _meaningful_rmse(decoy)) is not None]
    return math.log(here / min([float(np.median(elsewhere)), *mirrored]))


def _meaningful_rmse(evidence: Evidence) -> float | None:
    """Return the RMS distance of the agreeing walls [m]; None if they are too short."""
    return evidence.rmse_m if evidence.rmse_m and evidence.agreed_wall_m > _MEANINGFUL_M else None


def _agreement_of_things(evidence: Evidence) -> float:
    """Return the share of movable objects that agrees."""
    return evidence.agreed_things_m / (evidence.compared_things_m + _FEW_THINGS_M)


@cache
def _shipped() -> ConfidenceModel:
    return ConfidenceModel.from_json(
        resources.files("merging").joinpath("confidence_model.json").read_text(encoding="utf-8")
    )


Cell = TypeVar("Cell", bound=np.generic)


def find_decoys(target: WallMap, source: WallMap, config: MergeConfig, *, thoroughly: bool = True) -> list[Evidence]:
    """Return the evidence of the best poses of the source's mirror image in the target.

    `thoroughly` searches the mirror image like the source, for an unbiased estimate of chance. The coarse search takes
    a quarter of the time and may underestimate chance.
    """
    search = config.correlation if thoroughly else config.decoys
    found = find_candidates(target, mirror_image(source), config.model_copy(update={"correlation": search}))
    return [evidence for _, evidence in found]


def mirror_image(structure: WallMap) -> WallMap:
    """Return a map mirrored at its y axis."""
    return replace(
        structure,
        geometry=structure.geometry.mirrored(),
        points=structure.points * (-1.0, 1.0),
        normals=structure.normals * (-1.0, 1.0),
        states=_flipped(structure.states),
        distances_m=_flipped(structure.distances_m),
        nearest=_flipped(structure.nearest),
    )


def _flipped(cells: npt.NDArray[Cell]) -> npt.NDArray[Cell]:
    return np.ascontiguousarray(cells[:, ::-1])


_IN_DOUBT = (0.1, 0.999)
"""Between these probabilities decoys are searched thoroughly. This nearly never raises a probability."""


def score_hypotheses(
    target: WallMap, source: WallMap, places: Sequence[Evidence], config: MergeConfig, known: Sequence[Evidence] = ()
) -> tuple[list[float], list[Evidence]]:
    """Return the probability (K,) of each hypothesis from its evidence, at most 1 in sum, and the decoys.

    A coarse search for decoys decides most pairs. If it leaves doubt, decoys are searched as thoroughly as hypotheses.
    `places` (K,) is the evidence of the hypotheses. `known` are decoys that were found before. If these refuse all
    hypotheses, no others are searched, since further decoys nearly never raise a probability.
    """
    if known and max(likely := confidences(places, known), default=0.0) < config.verification.min_confidence:
        return likely, list(known)
    decoys = find_decoys(target, source, config, thoroughly=False)
    likely = confidences(places, decoys)
    if _IN_DOUBT[0] <= max(likely, default=0.0) < _IN_DOUBT[1]:
        decoys = find_decoys(target, source, config)
        likely = confidences(places, decoys)
    return likely, decoys
