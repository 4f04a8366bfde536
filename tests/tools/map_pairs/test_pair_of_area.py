import pytest

from merging.fusion import fuse, place
from tools.map_pairs.pair_of_area import pair_of_area
from tools.paper.map_pair import MapPair


@pytest.mark.parametrize("area_m2", [4125.0, 12100.0, 13200.0])
def test_a_pair_fills_its_area(area_m2):
    pair = pair_of_area(area_m2, 0.2)
    target, source = pair.target.grid, pair.source.grid
    merged = fuse([target, place(source, pair.T_target_source, target.geometry)]).grid.geometry
    assert merged.rows * merged.cols * merged.resolution**2 == pytest.approx(area_m2, rel=0.01)
    assert MapPair("a", "b", target, source, pair.T_target_source).overlap() > 0.2
