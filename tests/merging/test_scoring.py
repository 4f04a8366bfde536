import json
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

from merging import scoring
from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.fusion import warp
from merging.registration.correlation import find_candidates
from merging.scoring import (
    FEATURES,
    MEASURES,
    SIGNS,
    ConfidenceModel,
    by_chance,
    confidences,
    features,
    find_decoys,
    measured,
    mirror_image,
    score_hypotheses,
)
from merging.verification import Evidence, Pieces
from merging.walls import WallMap
from tbmslam.geometry.se2 import SE2

# The evidence for a right place, and for one that chance found.
GOOD = Evidence(
    overlap_m2=50.0, compared_wall_m=50.0, agreed_wall_m=44.0, conflicting_wall_m=2.0, unseen_wall_m=1.0,
    weakest_wall_m=20.0, rmse_m=0.03, agreement=0.88, conflict=0.04, larger_wall_m=120.0, seen_through_m=0.0,
    agreed_things_m=3.0, compared_things_m=6.0, pieces=Pieces(45.0, 2.0, 55.0, 20.0),
)  # fmt: skip
CHANCE = replace(
    GOOD, compared_wall_m=13.0, agreed_wall_m=5.0, conflicting_wall_m=4.0, weakest_wall_m=1.5, agreement=0.38,
    conflict=0.31, rmse_m=0.08, pieces=Pieces(6.0, 5.0, 20.0, 2.0),
)  # fmt: skip
DECOYS = [CHANCE] * 3
_MISFIT = FEATURES.index("log of misfit over chance")


def test_what_beats_chance_is_believed():
    found = confidences([GOOD, *[CHANCE] * 9], DECOYS)
    assert found[0] > 0.95
    assert sum(found) <= 1.0


def test_chance_is_not():
    assert max(confidences([CHANCE] * 10, DECOYS)) < 0.1


def test_what_fits_no_better_than_its_mirror_image_is_not():
    """However well: the buildings mirror each other, or a corridor looks the same everywhere."""
    assert confidences([GOOD, *[CHANCE] * 9], [GOOD])[0] < 0.6
    found = [confidences([GOOD, *[CHANCE] * 9], decoys) for decoys in ([CHANCE, GOOD, CHANCE], [GOOD])]
    np.testing.assert_allclose(found[0], found[1])


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
    worse = replace(GOOD, compared_wall_m=60.0, conflicting_wall_m=12.0, conflict=0.2)
    assert confidences([worse, *[CHANCE] * 9], DECOYS)[0] <= alone
    more = replace(GOOD, agreed_wall_m=48.0, weakest_wall_m=25.0, pieces=Pieces(50.0, 2.0, 55.0, 25.0))
    assert confidences([more, *[CHANCE] * 9], DECOYS)[0] >= alone


def test_walls_that_contradict_tell_a_false_place():
    """However many others agree: two rooms of a row are alike but for the wall behind them."""
    alone = confidences([GOOD, *[CHANCE] * 9], DECOYS)[0]
    for crossed in (replace(GOOD, compared_wall_m=75.0), replace(GOOD, seen_through_m=2.0)):
        doubtful = confidences([crossed, *[CHANCE] * 9], DECOYS)[0]
        assert 1.0 - doubtful > 3.0 * (1.0 - alone)


def test_things_that_agree_speak_for_a_place():
    shares = ((0.0, 0.0), (0.0, 9.0), (4.0, 9.0), (9.0, 9.0))
    none, moved, some, all_ = (
        confidences([replace(GOOD, agreed_things_m=agreed, compared_things_m=m), *[CHANCE] * 9], DECOYS)[0]
        for agreed, m in shares
    )
    assert none == moved < some < all_


def test_things_that_agree_elsewhere_as_well_say_nothing():
    """Columns of a hall stand in rows, and lie on those of its mirror image."""
    here = replace(GOOD, agreed_things_m=6.0, compared_things_m=8.0)
    columns = replace(CHANCE, agreed_things_m=6.0, compared_things_m=8.0)
    alone = confidences([here, *[CHANCE] * 9], DECOYS)[0]
    for others, decoys in (([columns, *[CHANCE] * 8], DECOYS), ([CHANCE] * 9, [columns])):
        assert features([here, *others], decoys)[0, FEATURES.index("agreement of things beyond chance")] == 0.0
        assert confidences([here, *others], decoys)[0] < alone


def test_corners_beyond_the_mirror_image_s_speak_for_all_places():
    """A corridor around a block is nearly its own mirror image, and yet more corners agree where it lies."""
    mirrored = replace(GOOD, pieces=Pieces(40.0, 3.0, 55.0, 15.0))
    told, alone = features([GOOD, CHANCE], [CHANCE, mirrored]), features([GOOD], [])
    share = (44.0 - 7.0) / (44.0 + 7.0 + 0.5)  # of 44 m that agree and 7 m that do not, as far as beyond chance
    for name, weight in (("log of corners over chance", 1.0), ("log of weighed corners over chance", share)):
        number = FEATURES.index(name)
        np.testing.assert_allclose(told[:, number], np.log1p(5.0 * weight))
        np.testing.assert_allclose(alone[:, number], np.log1p(20.0 * weight))


def test_walls_that_lie_nearer_than_elsewhere_speak_for_a_place():
    """However rough walls are, and however much maps bent: it shows elsewhere too."""
    misfits = [
        features([replace(GOOD, rmse_m=rough * here), *[replace(CHANCE, rmse_m=rough * 0.06)] * 9], [])[0, _MISFIT]
        for rough in (0.5, 1.0)
        for here in (0.01, 0.045, 0.06, 0.072, 0.12)
    ]
    np.testing.assert_allclose(misfits, [-0.5, *np.log([0.75, 1.0, 1.2]), 0.3] * 2, atol=1e-12)
    found = [confidences([replace(GOOD, rmse_m=m), *[CHANCE] * 9], DECOYS)[0] for m in (0.06, 0.08, 0.1)]
    assert found == sorted(found, reverse=True)
    assert found[0] > found[-1]


def test_walls_that_lie_as_near_on_the_mirror_image_say_nothing_if_it_has_as_many():
    def misfit(agreed_m: float, rmse_m: float) -> float:
        mirrored = replace(GOOD, agreed_wall_m=agreed_m, rmse_m=rmse_m)
        return float(features([replace(GOOD, rmse_m=0.05), *[CHANCE] * 9], [mirrored])[0, _MISFIT])

    few, as_many = 0.6 * GOOD.agreed_wall_m, 0.8 * GOOD.agreed_wall_m
    np.testing.assert_allclose(misfit(few, 0.05), np.log(0.05 / 0.08))
    np.testing.assert_allclose(misfit(as_many, 0.05), 0.0)
    np.testing.assert_allclose(misfit(as_many, 0.04), np.log(0.05 / 0.04))


def test_how_near_walls_lie_says_nothing_where_there_is_little_of_them():
    little = replace(CHANCE, agreed_wall_m=1.0)
    for places, decoys in (([GOOD], []), ([GOOD, little], [little]), ([little, GOOD], [CHANCE])):
        assert features(places, decoys)[0, _MISFIT] == 0.0
    assert features([replace(GOOD, rmse_m=None), CHANCE], [])[0, _MISFIT] == 0.0


def test_a_larger_overlap_that_fits_worse_does_not_hide_a_place_that_fits():
    """Floors of equal rooms lie on their mirror images with three quarters of their walls."""
    true = replace(
        GOOD, overlap_m2=460.0, compared_wall_m=412.0, agreed_wall_m=388.0, unseen_wall_m=12.0, weakest_wall_m=180.0,
        larger_wall_m=1020.0, pieces=Pieces(408.0, 10.0, 438.0, 108.0),
    )  # fmt: skip
    mirrored = replace(
        true, overlap_m2=540.0, compared_wall_m=560.0, agreed_wall_m=415.0, unseen_wall_m=23.0, seen_through_m=13.0,
        rmse_m=0.04, pieces=Pieces(420.0, 100.0, 565.0, 90.0),
    )  # fmt: skip
    assert confidences([true, *[mirrored] * 9], [mirrored])[0] > 0.9
    assert max(confidences([mirrored] * 9, [mirrored])) < 0.1


def test_a_better_decoy_never_helps():
    walls_and_corners = ((0.0, 0.0), (10.0, 2.0), (30.0, 10.0), (50.0, 20.0))
    decoys = [
        replace(CHANCE, compared_wall_m=50.0, agreed_wall_m=0.9 * m, pieces=Pieces(m, 2.0, 55.0, corners))
        for m, corners in walls_and_corners
    ]
    found = [confidences([GOOD, *[CHANCE] * 9], [decoy])[0] for decoy in decoys]
    assert found == sorted(found, reverse=True)
    assert 1.0 - found[-1] > 100.0 * (1.0 - found[0])


def test_walls_seen_through_count_against_decoys_of_deformed_maps_only():
    hypotheses, kept = [GOOD, *[CHANCE] * 9], [GOOD, replace(CHANCE, seen_through_m=0.0)]
    crossed = [replace(decoy, seen_through_m=metres) for decoy, metres in zip(kept, (4.0, 0.0), strict=True)]
    assert confidences(hypotheses, crossed) == pytest.approx(confidences(hypotheses, kept))
    assert confidences(hypotheses, kept, deformed=True) == pytest.approx(confidences(hypotheses, kept))
    assert confidences(hypotheses, crossed, deformed=True)[0] > confidences(hypotheses, kept)[0] + 0.2
    worse = confidences([replace(GOOD, seen_through_m=4.0)], crossed, deformed=True)
    assert worse == pytest.approx(confidences([GOOD], kept), abs=1e-6)  # both lose as much


def test_nothing_found_is_no_probability():
    assert confidences([], []) == []
    assert confidences([], [], deformed=True) == []
    assert 0.0 < confidences([GOOD], [])[0] < 1.0


def test_every_number_has_its_place():
    assert features([GOOD, CHANCE], DECOYS).shape == (2, len(FEATURES))
    assert features([], DECOYS).shape == (0, len(FEATURES))


def test_the_model_keeps_its_weights():
    model = ConfidenceModel(np.arange(float(len(MEASURES))), -2.5, np.arange(float(len(FEATURES))))
    again = ConfidenceModel.from_json(model.as_json())
    np.testing.assert_array_equal(again.score, model.score)
    np.testing.assert_array_equal(again.weights, model.weights)
    assert again.bias == model.bias


def test_the_shipped_weights_speak_as_their_signs_say():
    written = json.loads(resources.files("merging").joinpath("confidence_model.json").read_text(encoding="utf-8"))
    assert all(written["score"][name] * one.sign >= 0.0 for name, one in MEASURES.items())
    assert all(written["weights"][name] * sign >= 0.0 for name, sign in SIGNS.items())


def test_every_measure_has_its_place():
    assert measured([GOOD, CHANCE]).shape == (2, len(MEASURES))
    assert measured([]).shape == (0, len(MEASURES))


def test_a_large_overlap_half_of_which_agrees_speaks_for_nothing():
    """So it is by chance: of a ring of rooms laid on its mirror image much agrees, and as much does not."""
    ring = replace(GOOD, overlap_m2=500.0, compared_wall_m=160.0, agreed_wall_m=80.0, pieces=Pieces(90, 50, 180, 30))
    found = dict(zip(MEASURES, measured([ring])[0], strict=True))
    assert found["overlap beyond chance"] == found["corners beyond chance"] == found["surprise"] == 0.0


def test_chance_is_the_best_decoy_or_the_third_candidate():
    score = np.ones(len(MEASURES))
    good, chance = measured([GOOD]), measured([CHANCE])
    nothing = np.zeros((0, len(MEASURES)))
    np.testing.assert_array_equal(by_chance(good, nothing, score), 0.0)
    np.testing.assert_array_equal(by_chance(good, chance, score), chance[0])
    np.testing.assert_array_equal(by_chance(measured([GOOD, GOOD, CHANCE]), nothing, score), chance[0])
    np.testing.assert_array_equal(by_chance(chance, np.vstack((chance, good)), score), good[0])


def test_the_score_weighs_metres_and_pieces():
    """Logarithms of one more, as the shipped weights were fitted to."""
    row = dict(zip(MEASURES, np.expm1(measured([GOOD])[0]), strict=True))
    share = (44.0 - 7.0) / (44.0 + 7.0 + 0.5)
    expected = {
        "agreeing wall": 44.0,
        "other wall": 6.0,
        "agreeing pieces": 45.0,
        "wall against sliding": 20.0,
        "corners beyond chance": 20.0 * share,
        "overlap beyond chance": 50.0 * share / 5.0,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(row[name], value, err_msg=name)


def test_many_corners_say_no_more_than_some():
    number = FEATURES.index("log of corners")
    told = [
        features([replace(GOOD, pieces=Pieces(45.0, 2.0, 55.0, corners))], [])[0, number]
        for corners in (0.0, 3.0, 6.0, 30.0)
    ]
    np.testing.assert_allclose(told, np.log1p([0.0, 3.0, 6.0, 6.0]))


def test_a_feature_speaks_for_or_against():
    assert set(SIGNS.values()) == {-1, 1}


def test_a_model_is_written_to_six_digits():
    third = ConfidenceModel(np.full(len(MEASURES), 1.0 / 3.0), 2.0 / 3.0, np.full(len(FEATURES), 1.0 / 7.0))
    found = json.loads(third.as_json())
    assert set(found["score"].values()) == {0.333333}
    assert set(found["weights"].values()) == {0.142857}
    assert found["bias"] == 0.666667


CONFIG = MergeConfig()


def structure(grid):
    return WallMap.from_grid(grid, StructureConfig())


def test_a_mirror_image_is_what_the_mirrored_grid_looks_like(rooms):
    grid = rooms(1)
    seen, expected = mirror_image(structure(grid)), structure(grid.mirrored())
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
    stranger = structure(other.mirrored())
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


@pytest.mark.parametrize(("found", "looks"), [(0.84, []), (0.86, [False])])
def test_no_more_decoys_are_searched_if_known_ones_refuse_all(maps, monkeypatch, found, looks):
    seen = []
    monkeypatch.setattr(scoring, "find_decoys", lambda *_, thoroughly: seen.append(thoroughly) or ["new"])
    monkeypatch.setattr(scoring, "confidences", lambda _, decoys: [found if decoys == ["known"] else 0.05])
    likely, decoys = score_hypotheses(*maps, [None], CONFIG, ["known"])
    assert seen == looks
    assert (likely, decoys) == (([0.05], ["new"]) if looks else ([0.84], ["known"]))


def test_no_place_is_no_probability(maps):
    assert score_hypotheses(*maps, [], CONFIG)[0] == []


def test_a_thorough_search_finds_no_less_of_chance(maps):
    glance, look = (find_decoys(*maps, CONFIG, thoroughly=how) for how in (False, True))
    assert len(look) > len(glance)
    assert find_decoys(*maps, CONFIG) == look
    assert max(one.agreed_wall_m for one in look) > 0.8 * max(one.agreed_wall_m for one in glance)
