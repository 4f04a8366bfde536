import numpy as np
import pytest

from merging.config.registration import StructureConfig
from merging.nonrigid.tiles import middle_of, tiles_of
from merging.walls.wall_map import WallMap
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN


def cut(floor, side_m, most=100):
    return tiles_of(floor, side_m, most, StructureConfig())


def test_tiles_are_alike_in_size_and_hold_what_the_map_does(rooms):
    floor = rooms(1)  # 16 x 12 m
    tiles = cut(floor, 4.0)
    assert {tile.geometry[3:] for tile in tiles} == {(80, 80)}
    assert len(tiles) == 12
    free = floor.masses[..., FREE] > floor.masses[..., OCCUPIED]
    for tile in tiles:
        row, col = floor.geometry.cell_at(*tile.geometry.centre_of(0, 0))
        np.testing.assert_array_equal(tile.free, free[row : row + 80, col : col + 80])


def test_a_side_that_does_not_divide_the_map_is_the_longest(rooms):
    assert {tile.geometry[3:] for tile in cut(rooms(1), 7.0)} <= {(120, 107), (120, 106)}


def test_what_nobody_saw_is_cut_off_first(rooms):
    floor = rooms(1)
    masses = np.zeros((400, 700, 4), dtype=np.float32)
    masses[..., UNKNOWN] = 1.0
    masses[100:340, 200:520] = floor.masses
    tiles = cut(TbmGrid(floor.geometry._replace(rows=400, cols=700), masses), 20.0)
    assert [tile.geometry[1:] for tile in tiles] == [pytest.approx((10.0, 5.0, 240, 320))]


def test_large_maps_have_larger_tiles(rooms):
    assert 4 <= len(cut(rooms(1), 2.0, most=6)) <= 6


def test_tiles_of_hardly_any_wall_are_left_out(rooms):
    floor = rooms(1)
    floor.masses[:, :160] = (0.0, 1.0, 0.0, 0.0)
    floor.masses[50:90, 40] = (0.0, 0.0, 1.0, 0.0)  # two metres of wall
    assert {tile.geometry.origin_x for tile in cut(floor, 8.0)} == {8.0}


def test_the_middle_is_that_of_the_walls(rooms):
    floor = rooms(1)
    floor.masses[:] = (0.0, 1.0, 0.0, 0.0)
    floor.masses[40:80, 60] = (0.0, 0.0, 1.0, 0.0)
    np.testing.assert_allclose(middle_of(WallMap.from_grid(floor, StructureConfig())), (3.025, 3.0))
