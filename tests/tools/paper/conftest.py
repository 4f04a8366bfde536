import numpy as np
import pytest

from merging.fusion import warp
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import VACUOUS
from tbmslam.geometry.se2 import SE2
from tools.paper.map_pair import MapPair


@pytest.fixture(scope="session")
def pair():
    """Two grids of one floor of rooms, the source's frame turned and shifted, with a little noise in each."""
    generator = np.random.default_rng(2)
    masses = np.broadcast_to(VACUOUS, (160, 200, 4)).copy()
    masses[5:155, 5:195] = (0.0, 0.8, 0.0, 0.2)
    for _ in range(60):
        row, col = generator.integers(5, 140), generator.integers(5, 175)
        height, width = (2, generator.integers(5, 20)) if generator.random() < 0.5 else (generator.integers(5, 15), 2)
        masses[row : row + height, col : col + width] = (0.0, 0.0, 0.9, 0.1)
    target = TbmGrid(GridGeometry(0.1, 0.0, 0.0, 160, 200), masses.astype(np.float32))
    T_target_source = SE2(3.0, -2.0, 0.4)
    source = warp(target, T_target_source.inverse(), target.geometry)
    return MapPair("one", "two", target, source, T_target_source)
