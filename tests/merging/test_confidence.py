from dataclasses import replace

from merging.confidence import FEATURES, confidences, features
from merging.pieces import Pieces
from merging.verification import Evidence

GOOD = Evidence(
    overlap_m2=50.0, overlap_share=0.5, compared_wall_m=60.0, agreed_wall_m=50.0, conflicting_wall_m=2.0,
    unseen_wall_m=1.0, weakest_wall_m=20.0, rmse_m=0.03, agreement=0.83, conflict=0.03, worst_agreement=0.8,
    worst_conflict=0.05, smaller_wall_m=100.0, larger_wall_m=120.0, pieces=Pieces(45.0, 2.0, 55.0, 20.0),
)  # fmt: skip
CHANCE = replace(GOOD, compared_wall_m=15.0, agreed_wall_m=5.0, conflicting_wall_m=4.0, weakest_wall_m=1.5,
                 agreement=0.33, conflict=0.27, worst_agreement=0.2, worst_conflict=0.3, rmse_m=0.08,
                 pieces=Pieces(6.0, 5.0, 20.0, 2.0))  # fmt: skip


def test_what_stands_out_is_believed():
    found = confidences([GOOD, *[CHANCE] * 9])
    assert found[0] > 0.95
    assert sum(found) <= 1.0


def test_chance_is_not():
    assert max(confidences([CHANCE] * 10)) < 0.1


def test_two_places_as_good_share_the_probability():
    first, second, *_ = confidences([GOOD, GOOD, *[CHANCE] * 9])
    assert first == second
    assert 0.45 < first <= 0.5


def test_conflict_never_helps_and_wall_never_harms():
    alone = confidences([GOOD, *[CHANCE] * 9])[0]
    worse = replace(GOOD, conflicting_wall_m=15.0, conflict=0.25, worst_conflict=0.3)
    assert confidences([worse, *[CHANCE] * 9])[0] <= alone
    more = replace(GOOD, agreed_wall_m=55.0, weakest_wall_m=25.0, pieces=Pieces(50.0, 2.0, 55.0, 25.0))
    assert confidences([more, *[CHANCE] * 9])[0] >= alone


def test_nothing_found_is_no_probability():
    assert confidences([]) == []


def test_every_feature_has_its_number():
    assert features([GOOD, CHANCE]).shape == (2, len(FEATURES))
    assert features([]).shape == (0, len(FEATURES))


def test_a_candidate_like_all_others_does_not_stand_out():
    alike = features([CHANCE] * 10)
    apart = features([GOOD, *[CHANCE] * 9])
    for name in FEATURES:
        if "distinctness" in name:
            assert not alike[:, FEATURES.index(name)].any()
            assert apart[0, FEATURES.index(name)] > 1.0
