import json

import cv2
import numpy as np
import pytest

from merging.map_graph.grouping import Group
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tools.benchmark import main
from tools.benchmarks.fleet import _joined, _placed, draw_fleet, make_fleet

# One worker makes the maps for all of them.
pytestmark = pytest.mark.xdist_group("fleet")


@pytest.fixture(scope="module")
def placed():
    return make_fleet(2, 3, seed=3)


def test_a_fleet_is_so_many_maps_of_each_building_and_the_same_again(placed):
    assert sorted(one.place for one in placed.values()) == ["building 0"] * 3 + ["building 1"] * 3
    fleet, again, other = (make_fleet(1, 2, seed) for seed in (3, 3, 1))
    assert all(np.array_equal(one.occupancy, again[name].occupancy) for name, one in fleet.items())
    assert not np.array_equal(other["map_0"].occupancy, fleet["map_0"].occupancy)


def test_joins_are_counted_by_the_truth(placed):
    maps = {name: TbmMap.from_occupancy(one.occupancy, one.resolution) for name, one in placed.items()}
    here = [name for name, one in placed.items() if one.place == "building 0"]
    stranger = next(name for name, one in placed.items() if one.place == "building 1")
    right = {name: placed[name].T_map_building.inverse() for name in here}
    shifted = {**right, here[2]: SE2(0.0, 2.0, 0.0) @ right[here[2]]}
    assert _joined([Group(right)], placed, maps) == (3, 0)
    assert _joined([Group(shifted)], placed, maps) == (1, 2)
    assert _joined([Group({**right, stranger: SE2.identity()})], placed, maps) == (3, 3)
    assert _placed([Group(right)], placed) == 3
    assert _placed([Group({here[0]: SE2.identity(), stranger: SE2.identity()})], placed) == 2


def test_maps_of_a_building_are_merged_and_counted(tmp_path, capsys, monkeypatch):
    started = []
    monkeypatch.setattr(
        "tools.benchmarks.fleet.in_fresh_process", lambda run, *words: started.append(words) or run(*words)
    )
    figures = tmp_path / "fleet.json"
    assert main(["fleet", "1x2", "--seeds", "1,2", "--json", str(figures)]) == 0
    assert [words[:3] for words in started] == [(1, 2, 1), (1, 2, 2)]
    run, other = json.loads(figures.read_text())["fleets"]
    assert (run["seed"], other["seed"]) == (1, 2)
    assert (run["maps"], run["aligned"], run["groups"]) == (2, 1, 1)
    assert (run["right"], run["possible"], run["wrong"], run["placed"]) == (1, 1, 0, 2)
    assert 0.0 < run["cpu_s"] < 60.0
    assert "| 1" in capsys.readouterr().out


@pytest.mark.parametrize("size", ["1", "1x1", "axb", "-1x4", "9999x9999"])
def test_a_size_that_means_nothing_is_wrong_usage(size, usage_error):
    assert "BUILDINGSxMAPS" in usage_error(main, ["fleet", "--", size])


BLUE, VERMILION = (178, 114, 0), (0, 94, 213)


@pytest.fixture(scope="module")
def grid():
    """A free square with a wall along its upper side; nobody saw more."""
    masses = np.zeros((60, 60, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[20:40, 20:40] = (0.0, 0.9, 0.0, 0.1)
    masses[36:40, 20:40] = (0.0, 0.0, 0.9, 0.1)
    return TbmGrid(GridGeometry(0.1, 0.0, 0.0, 60, 60), masses)


def groups(*sizes):
    names = iter("abcdefgh")
    return [Group({next(names): SE2.identity() for _ in range(size)}) for size in sizes]


def drawn(*what):
    return cv2.imdecode(np.frombuffer(draw_fleet(*what), np.uint8), cv2.IMREAD_COLOR)


def count(picture, colour):
    return int((picture == colour).all(axis=2).sum())


def test_each_group_has_its_colour_and_maps_alone_have_none(grid):
    alone = drawn(groups(1, 1), [], [], grid)
    assert count(alone, BLUE) == 0
    two = drawn(groups(2, 2), [], [], grid)
    assert count(two, BLUE) == pytest.approx(count(two, VERMILION), rel=0.05)
    assert count(two, BLUE) > 100


def test_accepted_alignments_are_lines_of_their_group(grid):
    bare, joined = (drawn(groups(2, 1), pairs, [("a", "b")], grid) for pairs in ([], [("a", "b")]))
    assert count(joined, BLUE) > count(bare, BLUE) + 100


def test_the_map_lies_beside_it_with_its_walls_up(grid):
    picture = drawn(groups(2), [], [], grid)
    right = picture[:, -picture.shape[0] :, 0].astype(int)
    rows = np.flatnonzero((right == 0).sum(axis=1) > 50)
    assert 0 < len(rows) < 200
    assert rows.max() < picture.shape[0] / 2
