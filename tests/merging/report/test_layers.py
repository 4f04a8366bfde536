import numpy as np
import pytest

from merging.fusion import fuse
from merging.merger import Merge
from merging.report.layers import without_rounding
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap


def walled(*cols, rows=10, shift=0, resolution=0.1):
    """Return a map of free space with walls across it, in a part of a lattice of 10 cm cells."""
    grid = TbmGrid.unknown(GridGeometry(resolution, resolution * shift, 0.0, rows, 20))
    grid.masses[:] = (0.0, 0.9, 0.0, 0.1)
    grid.masses[:, cols] = (0.0, 0.0, 0.9, 0.1)
    return TbmMap(grid)


def merged(reliability=None, **maps):
    """Return what without_rounding leaves of the conflict of maps that are not moved."""
    trusts = reliability or {}
    fusion = fuse([one.grid for one in maps.values()], reliabilities=[trusts.get(name, 1.0) for name in maps])
    merge = Merge(TbmMap(fusion.grid), dict.fromkeys(maps, SE2.identity()), {}, {}, fusion)
    return fusion, without_rounding(merge, maps, trusts).fusion


@pytest.mark.parametrize("apart", [0, 1, 2])
def test_a_wall_in_the_next_cells_is_the_same_wall(apart):
    before, after = merged(a=walled(8), b=walled(8 + apart))
    assert bool(before.conflict.max() > 0.5) is (apart > 0)
    assert after.conflict.max() == 0.0


def test_a_wall_that_is_elsewhere_contradicts_as_it_did():
    before, after = merged(a=walled(8), b=walled(11))
    np.testing.assert_array_equal(after.conflict[2:-2], before.conflict[2:-2])
    assert sorted(set(np.nonzero(after.conflict)[1])) == [8, 11]
    assert after.grid is before.grid


@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.15, 0.2, 0.25, 0.3])
def test_a_door_that_is_open_in_one_map_and_shut_in_another_is_seen_with_any_cells(resolution):
    shut, opened = (walled(8, rows=30, resolution=resolution) for _ in range(2))
    door = round(0.9 / resolution)
    opened.grid.masses[3 : 3 + door, 8] = (0.0, 0.9, 0.0, 0.1)
    before, after = merged(a=shut, b=opened)
    assert before.conflict[3 : 3 + door, 8].min() > 0.5
    assert after.conflict[3 + door // 2, 8] == before.conflict[3 + door // 2, 8]


def test_one_map_that_denies_a_wall_is_enough():
    before, after = merged(a=walled(8), b=walled(9), c=walled())
    assert sorted(set(np.nonzero(after.conflict)[1])) == [8, 9]
    assert after.conflict[5, 8] == before.conflict[5, 8]


@pytest.mark.parametrize("trust", [0.0, 0.01, 1.0])
def test_a_map_of_reliability_zero_denies_no_wall(trust):
    maps = {"a": walled(8), "b": walled(9), "c": walled()}
    before, after = merged({"c": trust}, **maps)
    assert before.conflict[5, 8] > 0.5
    assert after.conflict[5, 8] == (before.conflict[5, 8] if trust > 0.0 else 0.0)


@pytest.mark.parametrize("trust", [0.0, 0.01])
def test_walls_of_a_map_of_reliability_zero_cause_no_conflict(trust):
    """What is as free as occupied is no wall, though what is free contradicts it."""
    torn = walled()
    torn.grid.masses[:, 8] = (0.0, 0.4, 0.4, 0.2)
    before, after = merged({"c": trust}, a=torn, b=walled(), c=walled(8))
    assert before.conflict[5, 8] > 0.3
    assert after.conflict[5, 8] == (before.conflict[5, 8] if trust > 0.0 else 0.0)


def test_cells_outside_a_map_are_not_denied():
    _, after = merged(a=walled(2, 8), b=walled(1, shift=10))  # whose wall is at column 11
    assert after.conflict[:, :10].max() == 0.0
    assert after.conflict[2:-2, 11].min() > 0.5


@pytest.mark.parametrize(("free_behind", "counts"), [(0, False), (1, False), (2, True)])
def test_where_a_map_ends_it_denies_nothing(free_behind, counts):
    """Beams that graze a wall and end elsewhere clear cells of it, and a sliver behind."""
    grazed = walled()
    grazed.grid.masses[:, 9 + free_behind :] = (0.0, 0.0, 0.0, 1.0)
    before, after = merged(a=walled(8), b=grazed)
    assert before.conflict[5, 8] > 0.5
    assert bool(after.conflict.max() > 0.5) is counts


def test_nothing_merged_has_nothing_to_be_shown():
    refused = Merge(None, {}, {}, {"a": "alone"}, None)
    assert without_rounding(refused, {}, {}) is refused
