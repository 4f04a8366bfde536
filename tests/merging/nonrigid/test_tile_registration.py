import math

import numpy as np
import pytest

from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.nonrigid.deformation import DeformableMap, deform, tiles_of
from merging.verification import examine
from merging.walls import WallMap
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import SE2
from tests.merging.bent_floor import bent_maps

CONFIG = MergeConfig.model_validate({"nonrigid": {"side_m": 8.0}})


def agreement(target, grid, motion):
    structure = WallMap.from_grid(grid, CONFIG.structure)
    return examine(target, structure, motion, CONFIG.verification).agreement


def test_an_equal_map_is_not_deformed(rooms):
    floor = rooms(1)
    found = deform(
        WallMap.from_grid(floor, CONFIG.structure), DeformableMap.of(floor, CONFIG), SE2(0.2, -0.1, 0.02), CONFIG
    )
    assert found.motion == pytest.approx(SE2.identity(), abs=1e-3)
    assert (found.residual_m, found.residual_rad) == pytest.approx((0.0, 0.0), abs=2e-3)
    np.testing.assert_array_equal(found.grid.is_known().sum(), floor.is_known().sum())


def test_a_distorted_map_fits_better_after_deformation():
    target, source, true = bent_maps("store")
    fixed = WallMap.from_grid(target.grid, CONFIG.structure)
    found = deform(fixed, DeformableMap.of(source.grid, MergeConfig()), true, MergeConfig())
    assert agreement(fixed, found.grid, found.motion) > agreement(fixed, source.grid, found.motion) + 0.2
    middle = np.array([np.mean(source.grid.geometry.bounds()[i::2]) for i in range(2)])
    assert math.dist(found.motion.apply(middle), true.apply(middle)) < 0.5
    assert 0.1 < found.residual_m < 1.0


@pytest.mark.parametrize("elsewhere", [SE2(100.0, 0.0, 0.0), SE2(9.0, 4.0, 1.0)])
def test_no_map_is_deformed_at_a_pose_where_few_tiles_fit(rooms, elsewhere):
    floor = rooms(1)
    assert (
        deform(WallMap.from_grid(floor, CONFIG.structure), DeformableMap.of(floor, CONFIG), elsewhere, CONFIG) is None
    )


def test_a_map_of_one_large_tile_starts_with_small_tiles(rooms):
    large, small = (
        DeformableMap.of(rooms(1), MergeConfig.model_validate({"nonrigid": {"side_m": side}})) for side in (8.0, 20.0)
    )
    assert [len(tiles) for tiles in large.rounds] == [4, 12, 12]
    assert [len(tiles) for tiles in small.rounds] == [4, 4]


def test_two_large_tiles_are_registered_before_small_ones(rooms):
    floor = rooms(1)
    floor.masses[160:] = (0.0, 0.0, 0.0, 1.0)  # 16 x 8 m are left
    first, *others = DeformableMap.of(floor, CONFIG).rounds
    assert len(first) == 2
    assert len(others) == 2
    assert all(len(tiles) > 2 for tiles in others)


def cut(floor, side_m, most=100):
    return tiles_of(floor, side_m, most, StructureConfig())


def test_tiles_have_one_size_and_the_cells_of_the_map(rooms):
    floor = rooms(1)  # 16 x 12 m
    tiles = cut(floor, 4.0)
    assert {tile.geometry[3:] for tile in tiles} == {(80, 80)}
    assert len(tiles) == 12
    free = floor.masses[..., FREE] > floor.masses[..., OCCUPIED]
    for tile in tiles:
        row, col = floor.geometry.cell_at(*tile.geometry.centre_of(0, 0))
        np.testing.assert_array_equal(tile.free, free[row : row + 80, col : col + 80])


def test_no_side_is_longer_than_requested(rooms):
    assert {tile.geometry[3:] for tile in cut(rooms(1), 7.0)} <= {(120, 107), (120, 106)}


def test_unknown_margins_are_cropped_first(rooms):
    floor = rooms(1)
    masses = np.zeros((400, 700, 4), dtype=np.float32)
    masses[..., UNKNOWN] = 1.0
    masses[100:340, 200:520] = floor.masses
    tiles = cut(TbmGrid(floor.geometry._replace(rows=400, cols=700), masses), 20.0)
    assert [tile.geometry[1:] for tile in tiles] == [pytest.approx((10.0, 5.0, 240, 320))]


def test_large_maps_have_larger_tiles(rooms):
    assert 4 <= len(cut(rooms(1), 2.0, most=6)) <= 6


def test_tiles_with_little_wall_are_left_out(rooms):
    floor = rooms(1)
    floor.masses[:, :160] = (0.0, 1.0, 0.0, 0.0)
    floor.masses[50:90, 40] = (0.0, 0.0, 1.0, 0.0)  # two metres of wall
    assert {tile.geometry.origin_x for tile in cut(floor, 8.0)} == {8.0}


def test_the_centroid_is_of_the_walls(rooms):
    floor = rooms(1)
    floor.masses[:] = (0.0, 1.0, 0.0, 0.0)
    floor.masses[40:80, 60] = (0.0, 0.0, 1.0, 0.0)
    np.testing.assert_allclose(WallMap.from_grid(floor, StructureConfig()).centroid, (3.025, 3.0))
