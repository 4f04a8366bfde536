import numpy as np
import pytest

from merging.contradictions import without_rounding
from merging.fusion import fuse
from merging.merger import Merge
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap


def walled(*cols, rows=10, shift=0):
    """Return a map of free space with walls across it, in a part of a lattice of 10 cm cells."""
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.1 * shift, 0.0, rows, 20))
    grid.masses[:] = (0.0, 0.9, 0.0, 0.1)
    grid.masses[:, cols] = (0.0, 0.0, 0.9, 0.1)
    return TbmMap(grid)


def merged(**maps):
    """Return what without_rounding leaves of the conflict of maps that are not moved."""
    fusion = fuse([one.grid for one in maps.values()])
    merge = Merge(TbmMap(fusion.grid), dict.fromkeys(maps, SE2.identity()), {}, {}, fusion)
    return fusion, without_rounding(merge, maps).fusion


@pytest.mark.parametrize("apart", [0, 1, 2])
def test_a_wall_in_the_next_cells_is_the_same_wall(apart):
    before, after = merged(a=walled(8), b=walled(8 + apart))
    assert bool(before.conflict.max() > 0.5) is (apart > 0)
    assert after.conflict.max() == 0.0


def test_a_wall_that_is_elsewhere_contradicts_as_it_did():
    before, after = merged(a=walled(8), b=walled(11))
    np.testing.assert_array_equal(after.conflict, before.conflict)
    assert sorted(set(np.nonzero(after.conflict)[1])) == [8, 11]
    assert after.grid is before.grid


def test_one_map_that_denies_a_wall_is_enough():
    before, after = merged(a=walled(8), b=walled(9), c=walled())
    assert sorted(set(np.nonzero(after.conflict)[1])) == [8, 9]
    assert after.conflict[5, 8] == before.conflict[5, 8]


def test_what_is_outside_a_map_is_denied_by_nobody():
    _, after = merged(a=walled(2, 8), b=walled(1, shift=10))  # whose wall is at column 11
    assert after.conflict[:, :10].max() == 0.0
    assert after.conflict[:, 11].min() > 0.5


def test_nothing_merged_has_nothing_to_be_shown():
    refused = Merge(None, {}, {}, {"a": "alone"}, None)
    assert without_rounding(refused, {}) is refused
