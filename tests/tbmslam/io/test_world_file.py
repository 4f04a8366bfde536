import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.map_pictures import write_pictures
from tbmslam.io.world_file import write_world_file

GEOMETRY = GridGeometry(0.05, -1.0 / 3.0, 12.5, 40, 30)


def test_six_lines_put_the_upper_left_pixel_where_its_cell_is(tmp_path):
    write_world_file(tmp_path / "a.png", GEOMETRY)
    step_x, skew_y, skew_x, step_y, x, y = map(float, (tmp_path / "a.pgw").read_text().split())
    assert (step_x, skew_y, skew_x, step_y) == (0.05, 0.0, 0.0, -0.05)
    assert (x, y) == GEOMETRY.centre_of(39, 0)


def test_rasterio_reads_the_picture_where_it_lies(tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    grid = TbmGrid.unknown(GEOMETRY)
    grid.masses[3, 7] = (0.0, 0.0, 1.0, 0.0)
    write_pictures(tmp_path, grid)
    with rasterio.open(tmp_path / "pignistic.png") as picture:
        assert tuple(picture.bounds) == pytest.approx(GEOMETRY.bounds())
        assert picture.res == pytest.approx((0.05, 0.05))
        ((wall,),) = picture.sample([GEOMETRY.centre_of(3, 7)])
        assert wall == 0
        assert np.count_nonzero(picture.read(1) == 0) == 1
