import pytest

from merging import MergeConfig
from merging.pairwise.all_pairs import align_all
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor


@pytest.mark.slow
def test_any_number_of_workers_finds_the_same(rooms):
    maps = {str(seed): TbmMap(rooms(seed)) for seed in (1, 2, 3)}
    alone, together = (align_all(maps, MergeConfig(), Executor(workers)) for workers in (1, 2))
    assert alone == together
    assert list(alone) == [("1", "2"), ("1", "3"), ("2", "3")]
