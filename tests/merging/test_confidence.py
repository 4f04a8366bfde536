from dataclasses import replace

import numpy as np

from merging.confidence import FEATURES, confidences, features
from merging.pieces import Pieces
from merging.verification import Evidence

GOOD = Evidence(
    overlap_m2=50.0, overlap_share=0.5, compared_wall_m=60.0, agreed_wall_m=50.0, conflicting_wall_m=2.0,
    unseen_wall_m=1.0, weakest_wall_m=20.0, rmse_m=0.03, agreement=0.83, conflict=0.03, worst_agreement=0.8,
    worst_conflict=0.05, smaller_wall_m=100.0, larger_wall_m=120.0, steady_compared_m=50.0, steady_agreed_m=44.0,
    steady_unseen_m=1.0, unbroken_m=0.0, pieces=Pieces(45.0, 2.0, 55.0, 20.0),
)  # fmt: skip
CHANCE = replace(GOOD, compared_wall_m=15.0, agreed_wall_m=5.0, conflicting_wall_m=4.0, weakest_wall_m=1.5,
                 agreement=0.33, conflict=0.27, worst_agreement=0.2, worst_conflict=0.3, rmse_m=0.08,
                 steady_compared_m=13.0, steady_agreed_m=5.0, steady_unseen_m=1.0,
                 pieces=Pieces(6.0, 5.0, 20.0, 2.0))  # fmt: skip


DECOYS = [CHANCE] * 3


def test_what_beats_chance_is_believed():
    found = confidences([GOOD, *[CHANCE] * 9], DECOYS)
    assert found[0] > 0.95
    assert sum(found) <= 1.0


def test_chance_is_not():
    assert max(confidences([CHANCE] * 10, DECOYS)) < 0.1


def test_what_fits_no_better_than_its_mirror_image_is_not():
    """However well: the buildings mirror each other, or a corridor looks the same everywhere."""
    assert confidences([GOOD, *[CHANCE] * 9], [GOOD])[0] < 0.6
    assert confidences([GOOD, *[CHANCE] * 9], [CHANCE, GOOD, CHANCE]) == confidences([GOOD, *[CHANCE] * 9], [GOOD])


def test_two_places_as_good_share_the_probability():
    first, second, *_ = confidences([GOOD, GOOD, *[CHANCE] * 9], DECOYS)
    assert first == second
    assert 0.45 < first <= 0.5


def test_of_four_places_as_good_none_is_believed():
    four = confidences([GOOD, GOOD, GOOD, GOOD, *[CHANCE] * 9], DECOYS)[:4]
    two = confidences([GOOD, GOOD, *[CHANCE] * 9], DECOYS)[:2]
    assert max(four) < 0.25
    assert sum(four) < sum(two)


def test_conflict_never_helps_and_wall_never_harms():
    alone = confidences([GOOD, *[CHANCE] * 9], DECOYS)[0]
    worse = replace(GOOD, steady_compared_m=60.0, conflicting_wall_m=15.0, conflict=0.25, worst_conflict=0.3)
    assert confidences([worse, *[CHANCE] * 9], DECOYS)[0] <= alone
    more = replace(
        GOOD, steady_agreed_m=48.0, agreed_wall_m=55.0, weakest_wall_m=25.0, pieces=Pieces(50.0, 2.0, 55.0, 25.0)
    )
    assert confidences([more, *[CHANCE] * 9], DECOYS)[0] >= alone


def test_steady_walls_that_contradict_tell_a_false_place():
    """However many others agree: two rooms of a row are alike but for the wall behind them."""
    crossed = replace(GOOD, steady_compared_m=75.0)
    alone, doubtful = (confidences([one, *[CHANCE] * 9], DECOYS)[0] for one in (GOOD, crossed))
    assert 1.0 - doubtful > 20.0 * (1.0 - alone)
    unbroken = confidences([replace(GOOD, unbroken_m=20.0), *[CHANCE] * 9], DECOYS)[0]
    assert doubtful <= unbroken < alone


def test_a_better_decoy_never_helps():
    walls_and_corners = ((0.0, 0.0), (10.0, 2.0), (30.0, 10.0), (50.0, 20.0))
    decoys = [
        replace(CHANCE, steady_compared_m=50.0, steady_agreed_m=0.9 * m, pieces=Pieces(m, 2.0, 55.0, corners))
        for m, corners in walls_and_corners
    ]
    found = np.array([features([GOOD, *[CHANCE] * 9], [decoy])[0] for decoy in decoys])
    margins = ["margin" in name for name in FEATURES]
    assert (np.diff(found, axis=0) <= 0.0).all()
    assert (found[-1] < found[0])[margins].all()


def test_nothing_found_is_no_probability():
    assert confidences([], []) == []
    assert 0.0 < confidences([GOOD], [])[0] < 1.0


def test_every_feature_has_its_number():
    assert features([GOOD, CHANCE], DECOYS).shape == (2, len(FEATURES))
    assert features([], DECOYS).shape == (0, len(FEATURES))


def test_a_candidate_like_all_others_has_no_margin():
    alike, apart = features([CHANCE] * 10, DECOYS), features([GOOD, *[CHANCE] * 9], DECOYS)
    for name in FEATURES:
        if "margin" in name:
            assert not alike[:, FEATURES.index(name)].any()
            assert apart[0, FEATURES.index(name)] > 0.5
