import numpy as np
import pytest

from merging import MergeConfig, group_map
from merging.group_map import GroupMap, group_maps_of
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.progress import Watch

WALL, FREE = (0.0, 0.1, 0.8, 0.1), (0.0, 0.9, 0.0, 0.1)


def room(wall_row):
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 20, 20))
    grid.masses[5:15, 5:15] = FREE
    grid.masses[wall_row, 5:15] = WALL
    return TbmMap(grid)


MAPS = {"a": room(5), "b": room(14), "c": room(9)}
ORDERS = ("a", "bare"), ("bare", "a")
POSES = {"a": SE2(7.0, 0.0, 0.0), "b": SE2(7.0, 1.0, 0.0)}


def test_it_lies_in_the_frame_of_one_of_its_maps_wherever_that_was():
    whole = GroupMap.of(MAPS, POSES, MergeConfig(), Watch())
    assert whole.poses == {"a": SE2.identity(), "b": SE2(0.0, 1.0, 0.0)}
    walls = np.argwhere(whole.grid.masses[..., 2] > 0.7)
    ys = {round(whole.grid.geometry.centre_of(float(row), float(col))[1], 2) for row, col in walls}
    assert ys == {0.55, 2.45}


def test_one_map_stays_as_it_is():
    whole = GroupMap.of(MAPS, {"c": SE2(3.0, 4.0, 1.0)}, MergeConfig(), Watch())
    assert whole.grid is MAPS["c"].grid
    assert whole.poses == {"c": SE2.identity()}


def test_its_frame_is_that_of_the_map_that_knows_most_whichever_is_named_first():
    bare = room(9)
    bare.grid.masses[5:8] = (0.0, 0.0, 0.0, 1.0)
    maps, poses = {"bare": bare, "a": MAPS["a"]}, {"bare": SE2(7.0, 1.0, 0.0), "a": SE2(7.0, 0.0, 0.0)}
    wholes = [GroupMap.of(maps, {name: poses[name] for name in names}, MergeConfig(), Watch()) for names in ORDERS]
    assert wholes[0].poses == {"a": SE2.identity(), "bare": SE2(0.0, 1.0, 0.0)}
    assert wholes[0].poses == wholes[1].poses
    np.testing.assert_array_equal(wholes[0].grid.masses, wholes[1].grid.masses)


@pytest.mark.parametrize(
    "wanted",
    [{"rule": "conjunctive"}, {"coverage": "overlap"}, {"reliability": {"a": 0.1}}, {"merged_resolution": 0.2}],
)
def test_what_the_merged_map_shall_hold_does_not_change_what_the_maps_know(wanted):
    asked, plain = (GroupMap.of(MAPS, POSES, MergeConfig.model_validate(one), Watch()) for one in (wanted, {}))
    assert asked.grid.geometry == plain.grid.geometry
    np.testing.assert_array_equal(asked.grid.masses, plain.grid.masses)


def test_what_is_too_large_to_be_one_map_is_left_out(caplog, monkeypatch):
    far = {"a": SE2.identity(), "b": SE2(3000.0, 3000.0, 0.0)}
    wholes = group_maps_of(MAPS, {"far": far, "near": POSES}, MergeConfig(merged_resolution=1.0), Watch())
    assert list(wholes) == ["near"]
    told = (
        "a, b are not looked at as one map: 3001 x 3001 m in cells of 0.1 m would be 9e+08 cells, more than the 4e+08"
    )
    assert caplog.messages == [f"{told} that are possible"]
    finer = group_maps_of(MAPS, {"ab": {**far, "b": SE2(500.0, 500.0, 0.0)}}, MergeConfig(resolution=0.01), Watch())
    assert finer == {}  # they would be looked at in these cells

    def none_left(*_):
        raise MemoryError

    monkeypatch.setattr(group_map, "merge_group", none_left)
    assert group_maps_of(MAPS, {"ab": POSES}, MergeConfig(), Watch()) == {}
    assert caplog.messages[-1] == "a, b are not looked at as one map: memory has run out"
