from dataclasses import replace

import pytest

from merging.nonrigid.deformed_model import DeformedModel, DeformedTests
from merging.verification import Evidence, Pieces

PASSED = DeformedTests(0.95, 0.97, 0.7)
MODEL = DeformedModel(-10.0, 1.5, 12.0)
EVIDENCE = Evidence(
    overlap_m2=30.0, compared_wall_m=20.0, agreed_wall_m=12.0, conflicting_wall_m=4.0, unseen_wall_m=1.0,
    weakest_wall_m=3.0, rmse_m=0.08, agreement=0.6, conflict=0.2, larger_wall_m=100.0, seen_through_m=0.5,
    agreed_things_m=1.0, compared_things_m=5.0, pieces=Pieces(12.0, 5.0, 19.0, 2.0),
)  # fmt: skip


def test_the_share_is_of_all_compared_blocks_and_one_more():
    assert DeformedTests.of(0.9, 0.8, EVIDENCE) == DeformedTests(0.9, 0.8, 0.6)


@pytest.mark.parametrize("changed", [{"aligned": 0.85}, {"among_rivals": 0.85}])
def test_the_less_certain_test_counts(changed):
    assert replace(PASSED, **changed).less_certain == 0.85
    assert replace(PASSED, **changed).confidence < PASSED.confidence
    assert replace(PASSED, among_rivals=1.0).confidence == PASSED.confidence


def test_more_agreeing_blocks_raise_the_confidence():
    assert replace(PASSED, agreeing_share=0.8).confidence > PASSED.confidence


def test_a_certain_test_has_finite_log_odds():
    sure, sorry = (replace(PASSED, aligned=p, among_rivals=p) for p in (1.0, 0.0))
    assert sure.features[1] == pytest.approx(-sorry.features[1])
    assert sure.confidence > 0.9
    assert sorry.confidence < 0.01


def test_both_tests_alone_do_not_make_an_alignment():
    """Pairs of different places pass both tests with such confidences."""
    assert replace(PASSED, agreeing_share=0.6).confidence < 0.85
    assert replace(PASSED, aligned=0.999, among_rivals=0.999, agreeing_share=0.8).confidence > 0.95


def test_the_weights_are_written_and_read():
    assert DeformedModel.from_json(MODEL.as_json()) == MODEL
    assert MODEL.confidence(PASSED) == pytest.approx(1.0 / (1.0 + (0.05 / 0.95) ** 1.5 * 2.718281828459045**1.6))
