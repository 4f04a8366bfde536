from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import check_grad

from merging import MergeConfig
from merging.scoring import FEATURES, MEASURES, SIGNS, ConfidenceModel
from merging.verification import Evidence, Pieces
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor
from tests.merging.bent_floor import bent_maps
from tools.calibration import Judgement, Trial, _surprise, acceptance_table, calibration_table, fit_model, held_out
from tools.map_pairs import KnownPair

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


@pytest.mark.parametrize("swapped", [False, True])
def test_the_evidence_of_distorted_maps_is_collected_after_deformation(swapped):
    target, source, true = bent_maps("store")
    pair = KnownPair("crop_store_1_100", target, source, true, 1.0)
    if swapped:
        pair = KnownPair("crop_store_1_100", source, target, true.inverse(), 1.0)
    rigid, bent = (of(pair, MergeConfig()) for of in (Trial.of, Trial.of_deformed))
    assert bent.near[0]
    assert bent.near.sum() == 1
    assert bent.candidates[0].agreed_wall_m > 1.5 * max(one.agreed_wall_m for one in rigid.candidates)
    assert len(bent.candidates) <= 1 + 2 * MergeConfig().nonrigid.rivals
    assert max(one.agreement for one in bent.decoys) < bent.candidates[0].agreement


def test_maps_that_do_not_fit_are_not_deformed():
    target, _, _ = bent_maps("store")
    empty = TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 30, 30)))
    for other in (empty, bent_maps("office")[0]):
        assert Trial.of_deformed(KnownPair("negd_store_office_1", target, other, None, None), MergeConfig()) is None


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
    near = [replace(one, right=np.zeros_like(one.right)) for one in trials()]
    assert fit_model(near).as_json() == fit_model(trials()).as_json()
    assert not any(one.right for one in left_out(near))


def test_nothing_found_is_judged_zero():
    none = Trial("negs_a_1", [], [CHANCE], np.zeros(0, bool), np.zeros(0, bool))
    model = fit_model(trials(12))
    assert none.judged(model).confidence == 0.0
    assert fit_model([*trials(12), none]).bias != pytest.approx(model.bias, abs=0.0)


JUDGED = [
    Judgement("crop_a_100", 0.95, True),
    Judgement("crop_a_015", 0.75, False),
    Judgement("crop_b_015", 0.65, True),
    Judgement("negs_a_1", 0.55, False),
]


def test_the_table_counts_what_would_be_accepted():
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in acceptance_table(JUDGED).splitlines()[2:]]
    assert rows[0] == ["0.5", "1/1", "1/2", "1", "1 of 1"]
    assert rows[2] == ["0.7", "1/1", "0/2", "1", "0 of 1"]


def test_confidences_are_held_against_what_came_true():
    assert "0.50 to 1.00 | 4     |       0.725 |        0.500" in calibration_table(JUDGED, (0.0, 0.5, 1.0))
