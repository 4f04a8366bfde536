import cv2
import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.io.map_pictures import draw_grid, write_pictures


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
