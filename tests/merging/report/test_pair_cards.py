import io
from collections import Counter

import numpy as np
import pytest
from PIL import Image

from merging import MergeConfig, merge
from merging.alignment import Alignment, PoseHypothesis
from merging.config.registration import StructureConfig, VerificationConfig
from merging.fusion import warp
from merging.merger import Merge
from merging.pair_picture import draw_alone, draw_pair
from merging.report import pair_cards
from merging.verification import examine
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap

CONFIG = MergeConfig(method="features")


@pytest.fixture
def maps(rooms):
    moved = warp(rooms(1), SE2(1.0, 2.0, 0.5), rooms(1).geometry)
    return {"here": TbmMap(rooms(1)), "there": TbmMap(moved), "foreign": TbmMap(rooms(2))}


def test_accepted_and_refused_pairs_have_cards_with_pictures(maps):
    result = merge(maps, CONFIG)
    cards, tables = pair_cards.pair_cards(result, maps, CONFIG)
    assert [card.title for card in cards] == ["there in here", "foreign in here", "foreign in there"]
    assert [card.verdict for card in cards] == ["accepted", "refused", "refused"]
    assert [card.good for card in cards] == [True, False, False]
    assert all(card.pictures for card in cards)
    for card, found in zip(cards, result.alignments.values(), strict=True):
        assert card.reason[1:-1] == found.reason[1:]
    assert {"confidence", "x", "θ", "overlap", "agreement", "contradiction", "inliers"} <= cards[0].figures.keys()
    assert tables == []


def test_alternatives_of_an_ambiguous_pair_are_pictured(maps):
    other = PoseHypothesis(SE2(1.0, 0.0, 0.0), 0.4, 12.0)
    found = Alignment(
        "correlation", accepted=False, reason="r", T_target_source=SE2.identity(), ambiguous=True, alternatives=(other,)
    )
    result = Merge(None, {}, {("here", "there"): found}, {}, None)
    (card,), _ = pair_cards.pair_cards(result, maps, CONFIG)
    assert card.verdict == "ambiguous"
    assert len(card.pictures) == 2
    assert (
        card.pictures[1].caption == "Alternative 1, at 1.000 m, 0.000 m, 0.00°: confidence 0.400, 12.0 m of wall agree."
    )


def test_the_pose_to_copy_is_the_one_that_the_other_maps_confirm(maps):
    other = PoseHypothesis(SE2(1.0, 0.0, 0.0), 0.1, 12.0)
    found = Alignment(
        "correlation", accepted=False, reason="r", T_target_source=SE2.identity(), confidence=0.4, alternatives=(other,)
    )
    pair, poses = ("here", "there"), {"here": SE2(5.0, 5.0, 0.0), "there": SE2(6.1, 5.0, 0.0)}
    for used, copied in (((pair,), "1.0000 0.0000 0.000"), ((), "0.0000 0.0000 0.000")):
        (card,), _ = pair_cards.pair_cards(Merge(None, poses, {pair: found}, {}, None, None, used), maps, CONFIG)
        assert card.copied == copied


@pytest.mark.parametrize(
    ("accepted", "used", "outvoted", "verdict", "good"),
    [
        (True, (), (("a", "b"),), "accepted, but outvoted", False),
        (False, (("a", "b"),), (), "confirmed by others", True),
        (False, (), (), "refused", False),
    ],
)
def test_what_the_other_maps_made_of_a_pair(rooms, accepted, used, outvoted, verdict, good):
    found = Alignment("correlation", accepted=accepted, reason="r")
    result = Merge(None, {}, {("a", "b"): found}, {}, None, None, used, outvoted)
    empty = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 4, 4))
    (card,), _ = pair_cards.pair_cards(result, {"a": TbmMap(rooms(1)), "b": TbmMap(empty)}, CONFIG)
    assert card.verdict == verdict
    assert card.good is good
    assert [picture.caption for picture in card.pictures] == ["The walls of a."]


def test_very_many_pairs_go_into_a_table_but_for_those_that_tell_most(maps, monkeypatch):
    monkeypatch.setattr(pair_cards, "MOST_CARDS", 1)
    cards, (table,) = pair_cards.pair_cards(merge(maps, CONFIG), maps, CONFIG)
    assert [card.verdict for card in cards] == ["accepted"]
    assert [row[:3] for row in table.rows] == [("here", "foreign", "refused"), ("there", "foreign", "refused")]


GREY, BLUE, ORANGE, GREEN, RED = (232, 236, 241), (28, 94, 170), (222, 130, 20), (16, 138, 76), (206, 22, 28)


def pixels(png):
    return Counter(map(tuple, np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).reshape(-1, 3).tolist()))


@pytest.fixture
def structure(rooms):
    return lambda seed: WallMap.from_grid(rooms(seed), StructureConfig())


def test_a_map_on_itself_is_green(structure):
    seen = pixels(draw_pair(structure(1), structure(1), SE2.identity(), VerificationConfig()))
    assert seen[GREEN] > 500
    assert seen[RED] + seen[BLUE] + seen[ORANGE] == 0


def test_walls_on_free_space_are_red_by_the_share_that_the_evidence_tells(structure):
    target, source, shift = structure(1), structure(1), SE2(1.0, 0.6, 0.0)
    config = VerificationConfig()
    seen, evidence = pixels(draw_pair(target, source, shift, config)), examine(target, source, shift, config)
    assert evidence.conflict > 0.2
    shown = seen[RED] / (seen[RED] + seen[GREEN])
    told = evidence.conflict / (evidence.conflict + evidence.agreement)
    assert shown == pytest.approx(told, abs=0.1)
    assert seen[BLUE] > 0
    assert seen[ORANGE] > 0


def test_maps_that_do_not_overlap_keep_their_colours(structure):
    seen = pixels(draw_pair(structure(1), structure(2), SE2(40.0, 0.0, 0.5), VerificationConfig()))
    assert seen[GREEN] + seen[RED] == 0
    assert seen[BLUE] > 200
    assert seen[ORANGE] > 200


def test_a_map_alone_and_one_without_walls(structure):
    assert pixels(draw_alone(structure(1)))[BLUE] > 500
    grid = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20))
    grid.masses[5:9, 5:9] = (0.0, 1.0, 0.0, 0.0)
    bare = WallMap.from_grid(grid, StructureConfig())
    assert pixels(draw_alone(bare))[GREY] > 0
    assert pixels(draw_pair(bare, structure(1), SE2.identity(), VerificationConfig()))[RED] == 0
