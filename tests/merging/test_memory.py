"""How much memory a merge takes for each cell of the box around large maps, most of which nobody saw."""

import tracemalloc

import numpy as np
import pytest

from merging.config import MergeConfig
from merging.config.registration import NonrigidConfig
from merging.merger import merge
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import canvas_of, resample
from tbmslam.belief.tiled_masses import TiledMasses, vacuous_masses
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap

# One worker draws the rings for all of them.
pytestmark = pytest.mark.xdist_group("rings")

ROWS, COLS = 1600, 2400
FREE, WALL = (0.0, 0.9, 0.0, 0.1), (0.0, 0.0, 0.9, 0.1)
MOTION = SE2(7.3, -4.1, 0.2)

RIGID, DEFORMABLE = 38, 50
"""Largest peak of a merge for each cell of the box of the first map, without the two maps, if no map may be deformed
and if one may. They reach 32 and 46. A rigid merge reached 67 when masses were arrays, which took 39 for the two maps.
"""


def ring():
    """Return a ring of corridors with rooms beside them, 120 x 80 m, of which 14 % are known."""
    rng, masses = np.random.default_rng(3), vacuous_masses(ROWS, COLS)
    rooms = [(50, ROWS - 50, 50, COLS - 50)]
    for _ in range(40):
        row, col = rng.integers(100, ROWS - 200), rng.integers(100, COLS - 200)
        high, wide = rng.integers(40, 100, 2)
        side = rng.integers(4)
        row, col = ((row, 100), (row, COLS - 100 - wide), (100, col), (ROWS - 100 - high, col))[side]
        rooms.append((row, row + high, col, col + wide))
    for top, bottom, left, right in rooms[1:]:
        masses[top - 2 : bottom + 2, left - 2 : right + 2] = WALL
        masses[top:bottom, left:right] = FREE
    for inner, belief in ((50, WALL), (52, FREE), (98, WALL)):
        frame = np.ones((ROWS - 2 * inner, COLS - 2 * inner), dtype=bool)
        frame[(hole := 100 - inner) : -hole, hole:-hole] = False
        masses[inner : ROWS - inner, inner : COLS - inner][frame] = belief
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, ROWS, COLS), TiledMasses.of(masses))


@pytest.fixture(scope="module")
def rings():
    return seen_twice(ring())


def seen_twice(first):
    second = resample(first, MOTION.inverse(), canvas_of(first.geometry, MOTION.inverse()))
    return {"a": TbmMap(first), "b": TbmMap(second)}


def test_what_nobody_saw_takes_no_memory(rings):
    grid = rings["a"].grid
    known = np.count_nonzero(grid.is_known()) / (ROWS * COLS)
    assert 0.1 < known < 0.2
    assert sum(tile.nbytes for tile in grid.cells.tiles.values()) < 2.0 * known * ROWS * COLS * 16


@pytest.mark.parametrize(("nonrigid", "most_bytes"), [(False, RIGID), (True, DEFORMABLE)])
def test_the_memory_of_a_merge_is_bounded(rings, rooms, nonrigid, most_bytes):
    config = MergeConfig().model_copy(update={"nonrigid": NonrigidConfig(enabled=nonrigid)})
    merge(seen_twice(rooms(3)), config)  # compiles
    tracemalloc.start()
    found = merge(rings, config)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.merged is not None
    error = found.poses["b"].inverse() @ MOTION
    assert np.hypot(error.x, error.y) < 0.1
    assert peak < most_bytes * ROWS * COLS
