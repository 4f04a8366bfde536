"""The alignment of two maps as they are."""

from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.rigid_alignment import _by_correlation
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid


def test_where_nothing_is_found_nothing_is_accepted():
    blank = WallMap.from_grid(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20)), StructureConfig())
    found = _by_correlation(blank, blank, MergeConfig())
    assert not found.accepted
    assert found.T_target_source is None
