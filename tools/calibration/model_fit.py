"""The fit of the confidence model, and its cross-validation over buildings."""

from collections.abc import Sequence

import numpy as np
from scipy import optimize

from merging.scoring import MEASURES, SIGNS, ConfidenceModel, by_chance
from tbmslam.geometry.se2 import FloatArray
from tbmslam.parallel.executor import Call, Executor
from tools.calibration.trial import Judgement, Trial
from tools.map_pairs.floors import floors_of

_PENALTY = 0.001
"""Penalty on the squared weights of standardised features, per pair."""
_MOST_PARTS = 12
"""Largest number of parts of the cross validation over buildings."""
_F = len(SIGNS)
_SIGNS = [*SIGNS.values(), *(item.sign for item in MEASURES.values())]


def fit_model(trials: Sequence[Trial]) -> ConfidenceModel:
    """Return the model of maximum likelihood with a quadratic penalty on its weights."""
    everything = np.vstack([np.hstack(item.numbers[:2]) for item in trials])
    strength = _PENALTY * sum(item.weight for item in trials) * (everything.std(axis=0) + 1e-9) ** 2

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        model = ConfidenceModel(parameters[1 + _F :], float(parameters[0]), parameters[1 : 1 + _F])
        value, slope = float(strength @ parameters[1:] ** 2), np.append(0.0, 2.0 * strength * parameters[1:])
        for item in trials:
            surprise, of_it = _surprise(item, model)
            value, slope = value + item.weight * surprise, slope + item.weight * of_it
        return value, slope

    begin = np.array([-3.0, *(0.5 * sign for sign in _SIGNS)])
    bounds = [(None, None), *((0.0 if sign > 0 else None, 0.0 if sign < 0 else None) for sign in _SIGNS)]
    found = optimize.minimize(loss, begin, jac=True, method="L-BFGS-B", bounds=bounds).x
    return ConfidenceModel(found[1 + _F :], float(found[0]), found[1 : 1 + _F])


def _surprise(trial: Trial, model: ConfidenceModel) -> tuple[float, FloatArray]:
    """Return the negative log likelihood of the truth, and its gradient (1 + F + M,) by bias and weights."""
    own_features, own, decoys = trial.numbers
    beyond = own - by_chance(own, decoys, model.score)
    logits = np.append(own_features @ model.weights + beyond @ model.score + model.bias, 0.0)
    shares = np.exp(logits - logits.max())
    shares /= shares.sum()
    true = np.append(trial.near, not trial.near.any())
    likely = max(float(shares @ true), 1e-300)
    change = (shares - shares * true / likely)[:-1]
    return -float(np.log(likely)), np.concatenate(([change.sum()], change @ own_features, change @ beyond))


def held_out(trials: Sequence[Trial], executor: Executor) -> list[Judgement]:
    """Judge each pair by a model that was fitted without its building.

    A pair of two buildings is judged without the first one.
    """
    shown = floors_of(item.name for item in trials)
    floors = sorted({floor for some in shown.values() for floor in some})
    parts = [set(floors[part::_MOST_PARTS]) for part in range(min(_MOST_PARTS, len(floors)))]
    used = [[item for item in trials if not shown[item.name] & part] for part in parts]
    models = executor.results([Call(str(number), fit_model, (some,)) for number, some in enumerate(used)])
    judged = []
    for item in trials:
        first = min(shown[item.name], default=floors[0])
        model = next(model for part, model in zip(parts, models, strict=True) if first in part)
        judged.append(item.judged(model))
    return judged
