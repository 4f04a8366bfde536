from dataclasses import replace

import numpy as np
import pytest

from merging.nonrigid.deformed_model import DeformedTests
from tests.merging.bent_floor import bent_maps
from tools.calibration.deformed_fit import DeformedTrial, TooFewPairsError, fit_deformed, trial_of
from tools.map_pairs.known_pair import KnownPair

# One worker makes and aligns the bent maps for all of them.
pytestmark = pytest.mark.xdist_group("bent_maps")


def trial(rng, *, right):
    """An attempt at the true pose passes its tests more clearly, and more blocks agree."""
    aligned, among_rivals = 1.0 / (1.0 + np.exp(-rng.normal(4.0 if right else 1.5, 1.0, 2)))
    share = rng.normal(0.75 if right else 0.62, 0.05)
    return DeformedTrial(DeformedTests(float(aligned), float(among_rivals), float(share)), right)


def trials(count=200):
    rng = np.random.default_rng(5)
    return [trial(rng, right=bool(index % 2)) for index in range(count)]


def test_the_fitted_model_separates_true_from_false_poses():
    some = trials()
    model = fit_deformed(some)
    assert model.less_certain_test > 0.0
    assert model.agreeing_share > 0.0
    judged = [(model.confidence(one.tests) >= 0.5) == one.right for one in some]
    assert np.mean(judged) > 0.95


def test_pairs_of_more_weight_count_more():
    some = trials()
    heavy = [one if one.right else replace(one, weight=10.0) for one in some]
    assert fit_deformed(heavy).confidence(some[0].tests) < fit_deformed(some).confidence(some[0].tests)


def test_a_fit_needs_an_attempt():
    with pytest.raises(TooFewPairsError, match="no map was deformed"):
        fit_deformed([])


@pytest.mark.parametrize("swapped", [False, True])
def test_an_attempt_at_bent_maps_is_right(swapped):
    target, source, true = bent_maps("store")
    pair = KnownPair("bent", target, source, true, 1.0)
    if swapped:
        pair = KnownPair("bent", source, target, true.inverse(), 1.0)
    found = trial_of(pair, 3.0)
    assert found is not None
    assert found.right
    assert found.weight == 3.0
    assert found.tests.less_certain > 0.85


def test_pairs_that_need_no_deformation_and_pairs_that_fit_nowhere_have_no_attempt():
    target, _, true = bent_maps("store")
    assert trial_of(KnownPair("same", target, target, true.identity(), 1.0)) is None
    assert trial_of(KnownPair("foreign", target, bent_maps("office")[0], None, 0.0)) is None
