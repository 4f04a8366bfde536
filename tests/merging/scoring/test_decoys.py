import numpy as np
import pytest

from merging import scoring
from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.fusion import warp
from merging.registration.correlation import find_candidates
from merging.scoring import confidences, find_decoys, mirror_image, mirrored, score_hypotheses
from merging.walls import WallMap
from tbmslam.geometry.se2 import SE2

CONFIG = MergeConfig()


def structure(grid):
    return WallMap.from_grid(grid, StructureConfig())


def test_a_mirror_image_is_what_the_mirrored_grid_looks_like(rooms):
    grid = rooms(1)
    seen, expected = mirror_image(structure(grid)), structure(mirrored(grid))
    assert seen.geometry == expected.geometry
    np.testing.assert_array_equal(seen.free, expected.free)
    np.testing.assert_allclose(seen.distances_m, expected.distances_m, atol=1e-6)
    order, other = np.lexsort(seen.points.T.round(6)), np.lexsort(expected.points.T.round(6))
    np.testing.assert_allclose(seen.points[order], expected.points[other], atol=1e-9)
    np.testing.assert_allclose(seen.weights[order], expected.weights[other])
    sure = ~seen.two_sided[order]
    np.testing.assert_allclose(seen.normals[order][sure], expected.normals[other][sure], atol=1e-6)


def test_a_mirror_image_knows_its_nearest_walls(rooms):
    seen = mirror_image(structure(rooms(2)))
    rows, cols = seen.geometry.rows // 2, seen.geometry.cols // 3
    x, y = seen.geometry.centre_of(float(rows), float(cols))
    nearest = seen.points[seen.nearest[rows, cols]]
    assert np.hypot(*(nearest - (x, y))) == pytest.approx(float(seen.distances_m[rows, cols]), abs=0.1)


def test_twice_mirrored_is_the_map_itself(rooms):
    once = structure(rooms(1))
    twice = mirror_image(mirror_image(once))
    assert twice.geometry.origin_x == pytest.approx(once.geometry.origin_x)
    np.testing.assert_array_equal(twice.points, once.points)
    np.testing.assert_array_equal(twice.nearest, once.nearest)


def test_the_mirror_image_of_a_mirrored_building_fits(rooms):
    grid = rooms(1)
    other = warp(grid, SE2(2.0, -1.0, 0.4), grid.geometry)
    stranger = structure(mirrored(other))
    alike = max(decoy.agreed_wall_m for decoy in find_decoys(structure(grid), stranger, CONFIG))
    chance = max(decoy.agreed_wall_m for decoy in find_decoys(structure(grid), structure(other), CONFIG))
    assert alike > 2.0 * chance


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

    monkeypatch.setattr(scoring, "find_decoys", glance)
    monkeypatch.setattr(scoring, "confidences", lambda _, decoys: [0.3 if decoys[0] else at_a_glance])
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
    assert find_decoys(*maps, CONFIG) == look
    assert max(one.agreed_wall_m for one in look) > 0.8 * max(one.agreed_wall_m for one in glance)
