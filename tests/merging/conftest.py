"""Maps to merge: rooms drawn by hand, and real ones where the data is at hand."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid

MAP_PAIRS = Path(__file__).resolve().parents[2] / ".." / "shared/data/map-pairs"


def grid_of_occupancy(occupancy: np.ndarray, resolution: float, origin: tuple[float, float] = (0.0, 0.0)) -> TbmGrid:
    """Read an occupancy in percent (-1 unknown) as the least committed belief with that pignistic probability."""
    probability = np.where(occupancy < 0, 0.5, occupancy / 100.0)
    masses = np.zeros((*occupancy.shape, 4), dtype=np.float32)
    masses[..., 1] = np.maximum(0.0, 1.0 - 2.0 * probability)
    masses[..., 2] = np.maximum(0.0, 2.0 * probability - 1.0)
    masses[..., 3] = 1.0 - masses[..., 1] - masses[..., 2]
    return TbmGrid(GridGeometry(resolution, *origin, *occupancy.shape), masses)


def draw_rooms(seed: int, rows: int = 240, cols: int = 320) -> np.ndarray:
    """Draw a floor (rows, cols) of rooms and clutter, 0 free and 100 occupied, unlike that of any other seed."""
    rng = np.random.default_rng(seed)
    floor = np.zeros((rows, cols), dtype=np.int8)
    floor[[0, 1, -2, -1]] = 100
    floor[:, [0, 1, -2, -1]] = 100
    for _ in range(7):
        row, col = rng.integers(20, rows - 20), rng.integers(20, cols - 20)
        floor[row : row + 2, max(0, col - rng.integers(20, 90)) : col] = 100
        floor[max(0, row - rng.integers(20, 90)) : row, col : col + 2] = 100
    for _ in range(25):
        row, col = rng.integers(5, rows - 15), rng.integers(5, cols - 15)
        floor[row : row + rng.integers(3, 9), col : col + rng.integers(3, 9)] = 100
    return floor


@pytest.fixture
def rooms() -> Callable[[int], TbmGrid]:
    """Return a function that makes the grid of a floor, 5 cm cells."""
    return lambda seed: grid_of_occupancy(draw_rooms(seed), 0.05)


@pytest.fixture
def real_map() -> TbmGrid:
    """Return a map of a real building."""
    path = MAP_PAIRS / "crop_vim23_100.npz"
    if not path.exists():
        pytest.skip(f"{path.name} is not here: the shared recordings are not part of the repository")
    with np.load(path) as pair:
        return grid_of_occupancy(pair["occ_a"], float(pair["resolution"]))
