import numpy as np
import pytest

from merging.fusion.conflict_places import conflict_places
from merging.fusion.fusion import Fusion
from tbmslam.belief.grid import GridGeometry, TbmGrid


def fusion(conflict):
    geometry = GridGeometry(0.1, 2.0, -1.0, *conflict.shape)
    return Fusion(TbmGrid.unknown(geometry), conflict.astype(np.float32), np.full(conflict.shape, 2, dtype=np.uint16))


def test_the_worst_place_comes_first_with_its_middle_and_area():
    conflict = np.zeros((30, 40))
    conflict[3, 4] = 0.9
    conflict[10:14, 20:22] = 0.5
    worst, other = conflict_places(fusion(conflict))
    assert (worst.x, worst.y) == pytest.approx((2.0 + 21 * 0.1, -1.0 + 12 * 0.1))
    assert (worst.area_m2, worst.conflict_m2) == pytest.approx((0.08, 0.04))
    assert (other.area_m2, other.conflict_m2) == pytest.approx((0.01, 0.009))
    assert conflict_places(fusion(conflict), count=1) == [worst]


def test_no_contradiction_has_no_place():
    assert conflict_places(fusion(np.full((5, 5), 0.05))) == []
