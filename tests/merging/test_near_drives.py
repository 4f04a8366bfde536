import math
from dataclasses import replace

import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.drives import plan_drives
from merging import MergeConfig, align, merge
from merging.alignment import Alignment, Alternative
from merging.near_drives import align_by_drives
from merging.redrawing import redraw
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap
from tests.merging.driven_map import map_of

CONFIG = MergeConfig()
T_WORLD_B = SE2(3.0, -2.0, 0.7)


def together(*maps):
    """One map of the drives of several, wherever these lie."""
    drives = tuple(drive for one in maps for drive in one.drives)
    return TbmMap(redraw([drive.keyframes for drive in drives], maps[0]), drives)


def laid_over(one, other, turn):
    """A map with its drive's middle where another's is."""
    here, there = (m.drives[0].keyframes.poses[:, :2].mean(axis=0) for m in (one, other))
    back = SE2(0.0, 0.0, turn).apply(here)
    return replace(one, drives=(one.drives[0].transformed(SE2(*(there - back), turn)),))


def by_drives(target, source):
    return align_by_drives({"target": target, "source": source}, [("target", "source")], CONFIG).get(
        ("target", "source")
    )


@pytest.fixture(scope="module")
def drives():
    office, other = make_world("office", 3), make_world("office", 8)
    first, second = plan_drives(office, 2, length=30.0, overlap=0.8, seed=1)
    elsewhere = plan_drives(other, 1, length=30.0, seed=1)[0]
    return map_of(office, first, 0.0), map_of(office, second, 0.0, T_WORLD_B), map_of(other, elsewhere, 0.0)


def test_one_drive_of_a_muddled_map_is_enough(drives):
    first, second, elsewhere = drives
    muddled = together(first, *(laid_over(elsewhere, first, turn) for turn in (1.0, 1.9, 2.8)))
    assert not align(muddled, second).accepted
    found = by_drives(muddled, second)
    assert found is not None
    assert found.alignment.accepted
    assert found.alignment.T_target_source == pytest.approx(T_WORLD_B, abs=0.05)
    assert found.alignment.reason.startswith("1 of 4 pairs of drives agree, the surest with confidence ")
    assert found.alignment.confidence > CONFIG.verification.min_confidence
    alone = redraw([muddled.drives[0].keyframes], muddled, CONFIG.near.range_m)
    assert found.grids[0].geometry == alone.geometry

    merged = merge({"crew": muddled, "late": second}, CONFIG)
    assert merged.alignments["crew", "late"].reason.startswith("by what was seen within 8.5 m: 1 of 4 pairs of drives")
    assert math.dist(merged.poses["late"].apply([0.0, 0.0]), T_WORLD_B.apply([0.0, 0.0])) < 0.3


def test_all_drives_of_all_pairs_are_aligned_at_once(drives, monkeypatch):
    first, second, elsewhere = drives
    maps = {"crew": together(first, elsewhere), "late": second, "lost": elsewhere, "too": second}
    pairs = [("crew", "late"), ("crew", "lost"), ("late", "lost"), ("late", "too")]
    asked = []

    def found(parts, _, __, pairs):
        asked.append((list(parts), pairs))
        return dict.fromkeys(pairs, Alignment("correlation", accepted=False, reason=""))

    monkeypatch.setattr("merging.near_drives.align_all", found)
    monkeypatch.setattr("merging.near_drives.redraw", lambda _, one, __: one.grid)
    assert align_by_drives(maps, pairs, CONFIG) == {}
    crew, others = ("crew, drive 1", "crew, drive 2"), ("late, drive 1", "lost, drive 1")
    assert asked == [([*crew, *others], [(one, other) for other in others for one in crew])]


def test_drives_of_another_building_do_not_agree(drives):
    first, second, elsewhere = drives
    crew = together(first, replace(second, drives=(second.drives[0].transformed(T_WORLD_B),)))
    assert by_drives(crew, elsewhere) is None


def test_two_maps_of_one_drive_are_not_looked_at_again(drives):
    first, second, _ = drives
    assert by_drives(first, second) is None


def test_a_place_that_is_no_pair_s_best_is_none(drives, monkeypatch):
    first, second, _ = drives
    crew = together(first, second, first)

    def found(_, __, ___, pairs):
        places = [SE2(10.0 * number, 0.0, 0.0) for number in range(1, 1 + len(pairs))]
        others = (Alternative(SE2.identity(), 0.3, 5.0),)
        return {
            pair: Alignment("correlation", False, "", place, confidence=0.4, alternatives=others)
            for pair, place in zip(pairs, places, strict=True)
        }

    monkeypatch.setattr("merging.near_drives.align_all", found)
    assert by_drives(crew, second) is None


def test_pairs_that_agree_by_an_alternative_are_told_as_such(drives, monkeypatch):
    first, second, _ = drives
    crew = together(first, second, first)

    def found(_, __, ___, pairs):
        here, there = SE2.identity(), SE2(10.0, 0.0, 0.0)
        return dict(
            zip(
                pairs,
                (
                    Alignment("correlation", True, "much", here, confidence=0.9),
                    Alignment("correlation", False, "", there, alternatives=(Alternative(here, 0.9, 5.0),)),
                    Alignment("correlation", False, "", there, alternatives=(Alternative(here, 0.0, 5.0),)),
                ),
                strict=True,
            )
        )

    monkeypatch.setattr("merging.near_drives.align_all", found)
    near = by_drives(crew, second)
    assert near is not None
    assert near.alignment.reason == "1 of 3 pairs of drives agree, 1 more by an alternative, the surest with much"
