import pytest

from merging import MergeConfig
from merging.fusion import at_resolution
from merging.pairwise import PreparedMaps, align_all
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor


@pytest.mark.slow
def test_any_number_of_workers_finds_the_same(rooms):
    maps = {str(seed): TbmMap(rooms(seed)) for seed in (1, 2, 3)}
    alone, together = (align_all(maps, MergeConfig(), Executor(workers)) for workers in (1, 2))
    assert alone == together
    assert list(alone) == [("1", "2"), ("1", "3"), ("2", "3")]


def test_a_coarse_map_leaves_the_other_pairs_their_fine_cells(rooms):
    fine, coarse = rooms(1), at_resolution(rooms(2), 0.1)
    views = PreparedMaps({"a": fine, "b": rooms(3), "coarse": coarse}, MergeConfig())
    sizes = {
        pair: [view.structure.geometry.resolution for view in views.of_pair(pair) if view is not None]
        for pair in (("a", "b"), ("a", "coarse"), ("coarse", "b"))
    }
    assert sizes == {("a", "b"): [0.05, 0.05], ("a", "coarse"): [0.1, 0.1], ("coarse", "b"): [0.1, 0.1]}


def test_a_map_is_looked_at_once_for_each_cell_size(rooms):
    views = PreparedMaps({"a": rooms(1), "b": rooms(2), "c": rooms(3)}, MergeConfig())
    assert views.of_pair(("a", "b"))[0] is views.of_pair(("c", "a"))[1]


def test_an_empty_map_is_prepared_to_none(rooms):
    empty = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 4, 4))
    target, source = PreparedMaps({"a": rooms(1), "empty": empty}, MergeConfig()).of_pair(("a", "empty"))
    assert target is not None
    assert source is None
