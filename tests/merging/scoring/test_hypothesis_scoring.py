import pytest

from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.fusion.warping import warp
from merging.registration.hypotheses import find_candidates
from merging.scoring import hypothesis_scoring
from merging.scoring.confidence import confidences
from merging.scoring.decoys import find_decoys
from merging.scoring.hypothesis_scoring import score_hypotheses
from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import SE2

CONFIG = MergeConfig()


@pytest.fixture
def maps(rooms):
    grid = rooms(1)
    other = warp(grid, SE2(2.0, -1.0, 0.4), grid.geometry)
    return tuple(WallMap.from_grid(one, StructureConfig()) for one in (grid, other))


@pytest.mark.parametrize(
    ("at_a_glance", "looks"),
    [(0.0, [False]), (0.05, [False]), (0.5, [False, True]), (0.9, [False, True]), (1.0, [False])],
)
def test_chance_is_searched_thoroughly_where_it_may_decide(maps, monkeypatch, at_a_glance, looks):
    seen = []

    def glance(*args, thoroughly=True):
        seen.append(thoroughly)
        return [thoroughly]

    monkeypatch.setattr(hypothesis_scoring, "find_decoys", glance)
    monkeypatch.setattr(hypothesis_scoring, "confidences", lambda _, decoys: [0.3 if decoys[0] else at_a_glance])
    likely, decoys = score_hypotheses(*maps, [None], CONFIG)
    assert seen == looks
    assert decoys == looks[-1:]
    assert likely == [0.3 if looks[-1] else at_a_glance]


def test_places_are_judged_beside_what_chance_achieves(maps):
    places = [evidence for _, evidence in find_candidates(*maps, CONFIG)]
    likely, decoys = score_hypotheses(*maps, places, CONFIG)
    assert likely == confidences(places, decoys)
    assert decoys in [find_decoys(*maps, CONFIG, thoroughly=how) for how in (False, True)]


def test_no_place_is_no_probability(maps):
    assert score_hypotheses(*maps, [], CONFIG)[0] == []


def test_a_thorough_search_finds_no_less_of_chance(maps):
    glance, look = (find_decoys(*maps, CONFIG, thoroughly=how) for how in (False, True))
    assert len(look) > len(glance)
    assert max(one.agreed_wall_m for one in look) > 0.8 * max(one.agreed_wall_m for one in glance)
