"""Maps of several small floors; of each floor two robots saw overlapping parts."""

import itertools
import math

import numpy as np
import pytest

from merging import MergeConfig
from merging.config.registration import StructureConfig
from merging.rounds import MapPlaces, similarity, similarity_of_all
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor
from tests.merging.conftest import draw_rooms
from tests.merging.floors import maps_of_floors, seen

# One worker draws and compares the floors for all of them.
pytestmark = pytest.mark.xdist_group("retrieval")


@pytest.fixture(scope="module")
def maps():
    return maps_of_floors()


@pytest.fixture(scope="module")
def alike(maps):
    return similarity_of_all(maps, MergeConfig(), Executor())


def places_of(tbm_map):
    return MapPlaces.of(WallMap.from_grid(tbm_map.grid, StructureConfig()))


def rank_of_sibling(name, alike):
    """Return how many maps look more like a map than the other map of its floor does."""
    floor = name.split()[0]
    others = {next(other for other in pair if other != name): value for pair, value in alike.items() if name in pair}
    sibling = next(value for other, value in others.items() if other.split()[0] == floor)
    return sum(value > sibling for value in others.values())


def test_maps_of_one_floor_are_most_similar(maps, alike):
    assert list(alike) == list(itertools.combinations(maps, 2))
    ranks = np.array([rank_of_sibling(name, alike) for name in maps])
    assert (ranks < 3).all()
    assert (ranks == 0).sum() >= 5


def test_the_similarity_does_not_depend_on_other_maps_or_their_order(maps, alike):
    some = ("1 right", "3 left", "3 right")
    assert similarity_of_all({name: maps[name] for name in some}, MergeConfig(), Executor()).items() <= alike.items()
    assert similarity(places_of(maps["3 left"]), places_of(maps["1 right"])) == alike["1 right", "3 left"]


def test_processes_find_the_same_similarity(maps, alike):
    some = {name: maps[name] for name in itertools.islice(maps, 4)}
    found = similarity_of_all(some, MergeConfig(), Executor(2))
    assert found == {pair: alike[pair] for pair in itertools.combinations(some, 2)}


def test_signatures_do_not_depend_on_the_frame():
    floor = draw_rooms(3)
    first, second = (places_of(seen(floor, np.s_[:], pose)) for pose in (SE2(0.0, 0.0, 0.0), SE2(4.0, 3.0, 1.0)))
    lengths = np.linalg.norm(first.signatures, axis=1)
    similarities = first.signatures @ second.signatures.T / lengths[:, None] / np.linalg.norm(second.signatures, axis=1)
    assert np.median(similarities.max(axis=1)) > 0.95


def test_similarities_are_exact_whole_numbers(maps):
    signatures = places_of(maps["1 left"]).signatures
    exact = signatures.astype(np.int64) @ signatures.astype(np.int64).T
    np.testing.assert_array_equal(signatures @ signatures.T, exact)
    assert exact.max() < 2**24


def test_chance_is_what_distant_places_of_the_map_have_in_common(maps):
    places = places_of(maps["2 right"])
    for number in (0, len(places) // 2, len(places) - 1):
        similar = [0.93] * 10  # what other maps have counts as ten places
        similar += [
            float(places.signatures[number] @ places.signatures[other]) / 3000.0**2
            for other in range(len(places))
            if math.dist(places.points[number], places.points[other]) > 8.0
        ]
        mean = sum(similar) / len(similar)
        squares = 10 * 0.05**2 + sum((one - mean) ** 2 for one in similar[10:])
        assert places.chance[number] == pytest.approx((mean, math.sqrt(squares / len(similar))), rel=1e-6)


def test_matches_of_self_similar_places_count_less(maps):
    places = places_of(maps["2 right"])
    often, seldom = (
        MapPlaces(places.points, places.signatures, np.full((len(places), 2), (mean, 0.05))) for mean in (0.99, 0.9)
    )
    others = places_of(maps["2 left"])
    assert similarity(often, others) < similarity(seldom, others)


def test_a_map_without_walls_is_like_none(maps):
    empty = places_of(TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20))))
    assert len(empty) == 0
    assert similarity(empty, places_of(maps["1 left"])) == similarity(empty, empty) == -math.inf
