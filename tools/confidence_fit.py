"""The confidence model, fitted on pairs of maps whose truth is known, and asked about pairs that it never met."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merging.aligner import view_of
from merging.candidates import find_candidates
from merging.confidence import MEASURES, SIGNS, ConfidenceModel, features, measured
from merging.config import MergeConfig
from merging.decoys import find_decoys
from merging.verification import Evidence
from tools.calibration_table import Judgement
from tools.conditional_logit import BoolArray, Choice, fit
from tools.pair_files import KnownPair
from tools.pair_floors import floors_of

_PENALTY = 0.001
_MOST_PARTS = 12
"""The buildings are left out in so many parts, one by one where there are no more."""


@dataclass(frozen=True)
class Trial:
    """What the aligner weighs of one pair, and what is true.

    Parameters
    ----------
    name
        The pair.
    candidates, decoys
        What speaks for and against each place, and the places of the mirror image.
    right
        Which candidates (K,) are the truth; none where no candidate is.
    near
        Which candidates (K,) lie where the truth does, be they turned a little too far. It is they that a fit learns
        from: what to tell apart are places, not how exactly they were met.
    weight
        How many usual pairs this one counts for.
    """

    name: str
    candidates: Sequence[Evidence]
    decoys: Sequence[Evidence]
    right: BoolArray
    near: BoolArray
    weight: float = 1.0

    @classmethod
    def of(cls, pair: KnownPair, config: MergeConfig, weight: float = 1.0) -> "Trial | None":
        """Search a pair for places; None where one of its maps is empty."""
        target, source = (view_of(one.grid, one.grid.geometry.resolution, config) for one in (pair.target, pair.source))
        if target is None or source is None:
            return None
        found = find_candidates(target.structure, source.structure, config)
        decoys = find_decoys(target.structure, source.structure, config)
        right, near = (np.array([of(motion) for motion, _ in found], np.bool_) for of in (pair.is_right, pair.is_near))
        return cls(pair.name, [evidence for _, evidence in found], decoys, right, near, weight)

    def judged(self, model: ConfidenceModel) -> Judgement:
        """Return what a model says of it."""
        p = model.probabilities(self.candidates, self.decoys)
        best = int(p.argmax()) if len(p) else None
        if best is None:
            return Judgement(self.name, 0.0, right=False)
        return Judgement(self.name, float(p[best]), bool(self.right[best]))


def fit_model(trials: Sequence[Trial]) -> ConfidenceModel:
    """Return the model of greatest likelihood: first the score that puts the truth before all else, then the logit."""
    signs = [one.sign for one in MEASURES.values()]
    score = fit([_ranking(one) for one in trials if one.near.any()], signs, _PENALTY, none=False).weights
    choices = [
        Choice(one.name, features(one.candidates, one.decoys, score), one.right, one.weight, one.near) for one in trials
    ]
    logit = fit(choices, list(SIGNS.values()), _PENALTY)
    return ConfidenceModel(score, logit.bias, logit.weights)


def held_out(trials: Sequence[Trial]) -> list[Judgement]:
    """Return what is said of each pair by a model that never met its building, or the first of its two."""
    shown = floors_of(one.name for one in trials)
    floors = sorted({floor for some in shown.values() for floor in some})
    parts = [set(floors[part::_MOST_PARTS]) for part in range(min(_MOST_PARTS, len(floors)))]
    models = [fit_model([one for one in trials if not shown[one.name] & part]) for part in parts]
    judged = []
    for one in trials:
        first = min(shown[one.name], default=floors[0])
        model = next(model for part, model in zip(parts, models, strict=True) if first in part)
        judged.append(one.judged(model))
    return judged


def _ranking(trial: Trial) -> Choice:
    """Return the choice among all places of a pair, those of the mirror image, which are wrong, among them."""
    wrong = np.zeros(len(trial.decoys), np.bool_)
    places = measured([*trial.candidates, *trial.decoys])
    return Choice(trial.name, places, np.concatenate((trial.near, wrong)), trial.weight)
