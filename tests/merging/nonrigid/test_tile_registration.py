import math

import numpy as np
import pytest

from merging.config import MergeConfig
from merging.nonrigid.tile_registration import DeformableMap, deform
from merging.verification.evidence import examine
from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import SE2
from tests.merging.bent_floor import bent_maps

CONFIG = MergeConfig.model_validate({"nonrigid": {"side_m": 8.0}})


def agreement(target, grid, motion):
    structure = WallMap.from_grid(grid, CONFIG.structure)
    return examine(target, structure, motion, CONFIG.verification).agreement


def test_a_map_that_is_not_bent_stays_as_it_is(rooms):
    floor = rooms(1)
    found = deform(
        WallMap.from_grid(floor, CONFIG.structure), DeformableMap.of(floor, CONFIG), SE2(0.2, -0.1, 0.02), CONFIG
    )
    assert found.motion == pytest.approx(SE2.identity(), abs=1e-3)
    assert (found.apart_m, found.apart_rad) == pytest.approx((0.0, 0.0), abs=2e-3)
    np.testing.assert_array_equal(found.grid.is_known().sum(), floor.is_known().sum())


def test_a_bent_map_fits_better_once_it_is_straightened():
    target, source, true = bent_maps("store")
    fixed = WallMap.from_grid(target.grid, CONFIG.structure)
    found = deform(fixed, DeformableMap.of(source.grid, MergeConfig()), true, MergeConfig())
    assert agreement(fixed, found.grid, found.motion) > agreement(fixed, source.grid, found.motion) + 0.2
    middle = np.array([np.mean(source.grid.geometry.bounds()[i::2]) for i in range(2)])
    assert math.dist(found.motion.apply(middle), true.apply(middle)) < 0.5
    assert 0.1 < found.apart_m < 1.0


@pytest.mark.parametrize("elsewhere", [SE2(100.0, 0.0, 0.0), SE2(9.0, 4.0, 1.0)])
def test_where_hardly_any_of_it_fits_it_is_not_bent(rooms, elsewhere):
    floor = rooms(1)
    assert (
        deform(WallMap.from_grid(floor, CONFIG.structure), DeformableMap.of(floor, CONFIG), elsewhere, CONFIG) is None
    )


def test_a_map_no_larger_than_a_tile_slides_in_halves_at_once(rooms):
    large, small = (
        DeformableMap.of(rooms(1), MergeConfig.model_validate({"nonrigid": {"side_m": side}})) for side in (8.0, 20.0)
    )
    assert [len(tiles) for tiles in large.rounds] == [4, 12, 12]
    assert [len(tiles) for tiles in small.rounds] == [4, 4]
