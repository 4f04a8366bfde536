"""Buildings that are no strangers by their looks: mirror images, and corridors that look the same everywhere."""

import numpy as np
import pytest

from datasets.synthetic.map_pairs.pairs import (
    Building,
    building_of_area,
    building_of_world,
    cut_pairs,
    foreign_pair,
    mirrored,
)
from merging import MergeConfig, align, scoring
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tools.benchmarks.strangers import make_pair
from tools.map_pairs.known_pair import KnownPair


@pytest.fixture(scope="module")
def wings():
    return building_of_world("wings", 41)


def symmetrical(building):
    """A building beside its mirror image, which together are their own mirror image."""
    both = np.hstack((building.occupancy, mirrored(building).occupancy))
    return Building(f"{building.name}twin", both, building.resolution)


def test_one_building_is_recognised(wings):
    pair = KnownPair.of(next(iter(cut_pairs(wings, 1, [0.5]))))
    found = align(pair.target, pair.source)
    assert found.accepted, found.reason
    assert pair.is_right(found.T_target_source)


def test_its_mirror_image_is_not(wings):
    pair = KnownPair.of(foreign_pair(wings, mirrored(wings), 1))
    found = align(pair.target, pair.source)
    assert not found.accepted, found.reason
    assert found.confidence < 0.1


def test_a_building_that_is_its_own_mirror_image_is_not_placed_by_half(wings):
    """Nothing tells its halves apart but the things that stand about: what is accepted must be right."""
    twin = symmetrical(wings)
    pair = KnownPair.of(next(iter(cut_pairs(twin, 2, [0.5]))))
    found = align(pair.target, pair.source)
    assert not found.accepted or pair.is_right(found.T_target_source), found.reason


def test_thin_walls_of_a_plan_are_compared_with_coarser_cells(rooms):
    occupied = TbmMap(rooms(3)).to_occupancy() == 100
    edges = occupied & ~(np.roll(occupied, 1, axis=0) & np.roll(occupied, 1, axis=1))  # walls of one cell
    plan = TbmMap.from_occupancy(np.where(edges, np.int8(100), np.int8(0)), 0.05)
    blocks = occupied.reshape(occupied.shape[0] // 2, 2, occupied.shape[1] // 2, 2).any(axis=(1, 3))
    coarse = TbmMap.from_occupancy(np.where(blocks, np.int8(100), np.int8(0)), 0.1)
    for found in (align(plan, coarse), align(coarse, plan)):
        assert found.accepted, found.reason
        assert found.T_target_source == pytest.approx((0.0, 0.0, 0.0), abs=0.1)


def test_a_self_similar_corridor_is_ambiguous():
    pair = KnownPair.of(next(iter(cut_pairs(building_of_world("corridor", 41), 1, [0.5]))))
    found = align(pair.target, pair.source)
    assert not found.accepted, found.reason
    assert found.ambiguous
    assert "fit about as well" in found.reason
    assert len(found.alternatives) >= 2


def test_a_pair_as_likely_wrong_as_right_is_refused():
    """The walls of these two parts of a simulated floor would fit elsewhere, too; only a lower limit accepts them."""
    (pair,) = cut_pairs(building_of_area(300.0, 4, 0.1), 4, [0.25])
    known = KnownPair.of(pair)
    alignment = align(known.target, known.source)
    assert 0.3 < alignment.confidence < 0.8
    assert not alignment.accepted
    assert alignment.reason.startswith(f"confidence {alignment.confidence:.3f} is under 0.85")
    lenient = MergeConfig.model_validate({"verification": {"min_confidence": 0.3}})
    assert align(known.target, known.source, lenient).accepted


def test_where_nothing_is_found_nothing_is_accepted():
    blank = TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20)))
    found = align(blank, blank)
    assert not found.accepted
    assert found.T_target_source is None


@pytest.mark.slow
def test_a_mirrored_building_is_accepted_without_decoys(monkeypatch):
    """Ablation of `merging.scoring.find_decoys`: without them 1 of 108 strangers of seed 77 is accepted, not none."""
    pair = make_pair("mirrored", 13, 77)
    assert not align(pair.target, pair.source).accepted
    monkeypatch.setattr(scoring, "find_decoys", lambda *_, **__: [])
    assert align(pair.target, pair.source).accepted
