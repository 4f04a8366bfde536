from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import check_grad

from merging.scoring import FEATURES, MEASURES, SIGNS, ConfidenceModel
from merging.verification import Evidence, Pieces
from tbmslam.parallel.executor import Executor
from tools.calibration.model_fit import _surprise, fit_model, held_out
from tools.calibration.trial import Trial

CHANCE = Evidence(
    overlap_m2=30.0, compared_wall_m=20.0, agreed_wall_m=12.0, conflicting_wall_m=4.0, unseen_wall_m=1.0,
    weakest_wall_m=3.0, rmse_m=0.08, agreement=0.6, conflict=0.2, larger_wall_m=100.0, seen_through_m=0.5,
    agreed_things_m=1.0, compared_things_m=5.0, pieces=Pieces(12.0, 5.0, 22.0, 2.0),
)  # fmt: skip


def left_out(trials):
    return held_out(trials, Executor())


def place(rng, *, true):
    """A place whose walls agree, more or less, or one that chance found."""
    agreed = rng.uniform(14.0, 20.0) if true else rng.uniform(6.0, 13.0)
    pieces = Pieces(agreed, 1.0, 22.0, rng.uniform(2.0, 8.0) if true else rng.uniform(0.0, 4.0))
    return replace(CHANCE, agreed_wall_m=agreed, weakest_wall_m=agreed / 3.0, pieces=pieces)


def trial(rng, name, *, known=True, weight=1.0):
    truth = np.arange(5) == (0 if known else -1)
    candidates = [place(rng, true=bool(one)) for one in truth]
    return Trial(name, candidates, [place(rng, true=False) for _ in range(3)], truth, truth, weight)


def trials(count=60):
    rng = np.random.default_rng(3)
    names = [f"crop_{'abcdef'[i % 6]}_{i}_050" if i % 3 else f"negs_{'abcdef'[i % 6]}_{i}" for i in range(count)]
    return [trial(rng, name, known=name.startswith("crop")) for name in names]


def test_the_fitted_model_separates_true_from_false_poses():
    judged = left_out(trials())
    crops = [one for one in judged if one.name.startswith("crop")]
    assert sum(one.right for one in crops) > 0.95 * len(crops)
    assert np.mean([one.confidence for one in crops]) > 0.8
    assert max(one.confidence for one in judged if one.name.startswith("neg")) < 0.8


def test_no_weight_has_the_wrong_sign():
    model = fit_model(trials())
    assert all(weight * sign >= 0.0 for weight, sign in zip(model.weights, SIGNS.values(), strict=True))
    assert all(weight * one.sign >= 0.0 for weight, one in zip(model.score, MEASURES.values(), strict=True))


def test_the_slopes_are_those_of_the_loss():
    one = trial(np.random.default_rng(1), "crop_a_1_050")
    count = len(FEATURES)

    def model(p):
        return ConfidenceModel(p[1 + count :], float(p[0]), p[1 : 1 + count])

    at = np.linspace(-0.1, 0.2, 1 + count + len(MEASURES))

    assert check_grad(lambda p: _surprise(one, model(p))[0], lambda p: _surprise(one, model(p))[1], at) < 1e-4


def test_a_pair_that_weighs_more_moves_the_fit_more():
    some = trials(30)
    odd = trial(np.random.default_rng(9), "negs_g_99", known=False)
    odd = replace(
        odd, candidates=[place(np.random.default_rng(8), true=True)], right=np.zeros(1, bool), near=np.zeros(1, bool)
    )
    light, heavy = (fit_model([*some, replace(odd, weight=weight)]) for weight in (0.1, 20.0))
    assert odd.judged(heavy).confidence < odd.judged(light).confidence


def test_a_fit_learns_from_what_lies_near_the_truth():
    some = trials(18)
    near = [replace(one, right=np.zeros_like(one.right)) for one in some]
    assert fit_model(near).as_json() == fit_model(some).as_json()
    assert not any(one.right for one in left_out(near))


def test_nothing_found_is_judged_zero():
    none = Trial("negs_a_1", [], [CHANCE], np.zeros(0, bool), np.zeros(0, bool))
    model = fit_model(trials(12))
    assert none.judged(model).confidence == 0.0
    assert fit_model([*trials(12), none]).bias != pytest.approx(model.bias, abs=0.0)
