import cv2
import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.io.pictures import draw_grid, encode_png, write_pictures, write_world_file


def random_grid(rows, cols):
    masses = np.random.default_rng(0).dirichlet(np.ones(4), size=(rows, cols)).astype(np.float32)
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, rows, cols), masses)


def test_certain_cells_are_black_white_and_grey():
    grid = TbmGrid(GridGeometry(0.05, 0.0, 0.0, 4, 1), np.eye(4, dtype=np.float32)[:, None])
    pictures = draw_grid(grid)
    # From the top row, the largest y: UNKNOWN, OCCUPIED, FREE, CONFLICT.
    assert pictures["pignistic"][:, 0].tolist() == [128, 0, 255, 128]
    for name, column in {"unknown": [255, 0, 0, 0], "occupied": [0, 255, 0, 0]}.items():
        assert pictures[name][:, 0].tolist() == column
    assert pictures["free"][:, 0].tolist() == [0, 0, 255, 0]
    assert pictures["conflict"][:, 0].tolist() == [0, 0, 0, 255]


@pytest.mark.parametrize("rows", [1, 64, 200])
def test_shares_become_greys_in_every_block_of_rows(rows):
    grid = random_grid(rows, 9)
    pictures = draw_grid(grid)
    values = {"pignistic": 1.0 - grid.pignistic()}
    for name, subset in {"free": FREE, "occupied": OCCUPIED, "unknown": UNKNOWN, "conflict": CONFLICT}.items():
        values[name] = grid.masses[..., subset]
    for name, expected in values.items():
        np.testing.assert_allclose(pictures[name], 255.0 * expected[::-1], atol=0.501, err_msg=name)


def test_files_hold_the_pictures_and_are_the_same_every_time(tmp_path):
    grid = random_grid(30, 20)
    write_pictures(tmp_path / "a", grid)
    write_pictures(tmp_path / "b", grid)
    pictures = draw_grid(grid)
    assert {path.name for path in (tmp_path / "a").iterdir()} == {
        "pignistic.pgw",
        *(f"{name}.png" for name in pictures),
    }
    for name, picture in pictures.items():
        path = tmp_path / "a" / f"{name}.png"
        np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), picture)
        assert path.read_bytes() == (tmp_path / "b" / f"{name}.png").read_bytes()


@pytest.mark.parametrize("shape", [(3, 5), (3, 5, 3)])
def test_a_picture_reads_back_as_it_was(shape):
    picture = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    read = cv2.imdecode(np.frombuffer(encode_png(picture), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, picture)


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
