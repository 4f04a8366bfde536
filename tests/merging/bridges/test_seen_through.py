"""The likelihood of walls that are seen through, and the confidence of two groups that they give."""

import math
from dataclasses import replace

import numpy as np
import pytest

from merging import MergeConfig, merge
from merging.alignment import Alignment, PoseHypothesis
from merging.bridges import seen_through
from merging.bridges.seen_through import AT_FALSE_POSES, AT_TRUE_POSES, confidences_of_groups, weighted_log_ratio
from merging.verification import Evidence, Pieces
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tests.merging.conftest import draw_rooms, grid_of_occupancy
from tools.benchmarks.fleet import make_fleet
from tools.benchmarks.stranger_sets import make_set
from tools.map_pairs.placed_maps import maps_by_name

NOTHING = Evidence(0, 0, 0, 0, 0, 0, None, 0, 0, 0, 0, 0, 0, Pieces(0, 0, 0, 0))
FLOOR = TbmMap(grid_of_occupancy(draw_rooms(3), 0.05))


def seen(through_m, compared_m):
    return replace(NOTHING, seen_through_m=through_m, compared_wall_m=compared_m)


@pytest.mark.parametrize("kind", [AT_TRUE_POSES, AT_FALSE_POSES])
@pytest.mark.parametrize("compared_m", [0.0, 12.0, 85.0, 400.0])
def test_the_density_of_all_lengths_sums_to_one(kind, compared_m):
    lengths = np.geomspace(seen_through._NOTHING_M, 200.0, 4000)
    densities = np.exp([kind.log_density(length, compared_m) for length in lengths])
    total = math.exp(kind.log_density(0.0, compared_m)) + np.trapezoid(densities, lengths)
    assert total == pytest.approx(1.0, abs=0.09 * (1.0 - math.exp(-kind.per_m * compared_m)) + 3e-4)


def test_the_density_is_that_of_a_poisson_number_of_exponential_lengths():
    rng = np.random.default_rng(7)
    numbers = rng.poisson(AT_FALSE_POSES.per_m * 40.0, 200_000)
    lengths = rng.gamma(np.maximum(numbers, 1), seen_through._LENGTH_M) * (numbers > 0)
    edges = np.arange(0.1, 5.0, 0.1)
    counted = np.histogram(lengths, edges)[0] / len(lengths) / 0.1
    middles = (edges[1:] + edges[:-1]) / 2.0
    stated = [math.exp(AT_FALSE_POSES.log_density(middle, 40.0)) for middle in middles]
    np.testing.assert_allclose(stated, counted, atol=0.02)
    assert math.exp(AT_FALSE_POSES.log_density(0.0, 40.0)) == pytest.approx(np.mean(numbers == 0), abs=0.001)


def test_long_walls_that_nothing_sees_through_support_a_pose():
    ratios = [weighted_log_ratio(seen(0.0, compared_m)) for compared_m in (0.0, 10.0, 50.0, 200.0)]
    assert ratios == sorted(ratios)
    assert ratios[-1] == pytest.approx(math.log(1000.0))
    assert ratios[0] == pytest.approx(0.0, abs=0.01)
    assert ratios[1] == pytest.approx(0.55, abs=0.01)


def test_walls_seen_through_refute_a_pose_unless_the_compared_walls_are_long():
    ratios = [weighted_log_ratio(seen(through_m, 85.0)) for through_m in (0.0, 0.5, 1.0, 2.0, 4.0, 20.0)]
    assert ratios == sorted(ratios, reverse=True)
    assert ratios[-2] < -9.0
    assert weighted_log_ratio(seen(1.0, 85.0)) < 0.0 < weighted_log_ratio(seen(1.0, 400.0))


@pytest.mark.parametrize(("through_m", "ratio"), [(0.0, 4.63), (0.5, 0.29), (1.0, -1.89)])
def test_evidence_in_favour_counts_half(through_m, ratio):
    assert weighted_log_ratio(seen(through_m, 85.0)) == pytest.approx(ratio, abs=0.01)


def alignment_of(confidence, evidence, others=()):
    alternatives = tuple(PoseHypothesis(SE2(5.0, 0.0, 0.0), each, 10.0) for each in others)
    pose = SE2.identity()
    return Alignment("correlation", True, "", pose, confidence=confidence, evidence=evidence, alternatives=alternatives)


def test_the_odds_of_a_pose_change_by_the_weighted_ratio():
    found = alignment_of(0.2, seen(0.3, 40.0))
    (confidence,) = confidences_of_groups(found, FLOOR, FLOOR, MergeConfig())
    odds = 0.25 * math.exp(weighted_log_ratio(seen(0.3, 40.0)))
    assert confidence == pytest.approx(odds / (1.0 + odds))


def test_another_pose_that_sees_through_walls_makes_a_pose_more_likely():
    found = alignment_of(0.45, seen(0.0, 60.0), [0.45])
    here, elsewhere = confidences_of_groups(found, FLOOR, FLOOR, MergeConfig())
    assert here > 0.99
    assert elsewhere < 0.001


def test_a_sure_prior_does_not_outweigh_a_wall_that_is_seen_through():
    (confidence,) = confidences_of_groups(alignment_of(1.0, seen(4.0, 60.0)), FLOOR, FLOOR, MergeConfig())
    assert confidence < 0.1


def test_an_alignment_without_evidence_keeps_its_confidence():
    assert confidences_of_groups(alignment_of(0.6, None), FLOOR, FLOOR, MergeConfig()).tolist() == [0.6]
    assert not len(confidences_of_groups(Alignment("correlation", False, ""), FLOOR, FLOOR, MergeConfig()))


@pytest.mark.slow
@pytest.mark.parametrize("ablated", [False, True])
def test_two_stores_with_equal_aisles_are_one_only_without_the_walls_seen_through(monkeypatch, ablated):
    fleet = {
        name: each for name, each in make_fleet(30, 10, 9103).items() if each.place in ("building 12", "building 19")
    }
    if ablated:
        monkeypatch.setattr(seen_through, "weighted_log_ratio", lambda _: 0.0)
    found = merge(maps_by_name(fleet))
    assert len({fleet[name].place for name in found.poses}) == (2 if ablated else 1)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "seed"), [(135, 7301), (211, 8801)])
@pytest.mark.parametrize("ablated", [False, True])
def test_two_ends_of_a_floor_are_one_only_if_clean_walls_count_fully(monkeypatch, number, seed, ablated):
    if ablated:
        monkeypatch.setattr(seen_through, "_IN_FAVOUR", 1.0)
    placed = make_set(number, seed)
    found = merge(maps_by_name(placed))
    assert len({placed[name].place for name in found.poses}) == (2 if ablated else 1)
