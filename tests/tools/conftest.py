"""Recordings and maps that the programs are tried on; nothing may write into them."""

import math

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.geometry.se2 import SE2
from tbmslam.io import map_folder
from tbmslam.map.tbm_map import TbmMap
from tools import make_world


@pytest.fixture(scope="session")
def bags(tmp_path_factory):
    """Two robots that drive for 16 s in a flat, and where they truly were."""
    folder = tmp_path_factory.mktemp("bags")
    small = ["--beams", "181", "--rate", "5", "--duration", "16"]
    arguments = ["--world", "apartment", "--robots", "2", *small, "-o", str(folder)]
    assert make_world.main(arguments) == 0
    return folder


@pytest.fixture(scope="session")
def bag(bags):
    return bags / "robot_0.bag"


def floor(seed):
    """A floor of rooms, 16 m by 12 m."""
    rng = np.random.default_rng(seed)
    masses = np.zeros((240, 320, 4), dtype=np.float32)
    masses[..., 1] = 1.0
    walls = np.zeros((240, 320), dtype=bool)
    walls[[0, 1, -2, -1]] = walls[:, [0, 1, -2, -1]] = True
    for _ in range(8):
        row, col = rng.integers(30, 210), rng.integers(30, 290)
        walls[row : row + 2, max(0, col - rng.integers(20, 90)) : col] = True
        walls[max(0, row - rng.integers(20, 90)) : row, col : col + 2] = True
    masses[walls] = (0.0, 0.0, 1.0, 0.0)
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, 240, 320), masses)


@pytest.fixture(scope="session")
def folders(tmp_path_factory):
    """Two robots' maps of one floor, one of another floor, and an empty one."""
    root = tmp_path_factory.mktemp("maps")
    turned = resample(floor(1), SE2(2.0, 3.0, math.radians(70.0)), GridGeometry(0.05, -20.0, -20.0, 900, 900))
    empty = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20))
    for name, grid in {
        "here": floor(1),
        "there": turned.cropped_to_known(),
        "foreign": floor(2),
        "empty": empty,
    }.items():
        map_folder.save_map(root / name, TbmMap(grid))
    return root


@pytest.fixture
def usage_error(capsys):
    """Return a function that calls a program with wrong words, and returns its message."""

    def message_of(main, *words):
        with pytest.raises(SystemExit) as left:
            main(*words)
        assert left.value.code == 2
        return capsys.readouterr().err

    return message_of
