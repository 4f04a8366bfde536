import numpy as np
import pytest

from merging.map_graph.grouping import Group
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tools.benchmarks.fleet_picture import draw_fleet

BLUE, VERMILION = (178, 114, 0), (0, 94, 213)


@pytest.fixture(scope="module")
def grid():
    """A free square with a wall along its upper side; nobody saw more."""
    masses = np.zeros((60, 60, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[20:40, 20:40] = (0.0, 0.9, 0.0, 0.1)
    masses[36:40, 20:40] = (0.0, 0.0, 0.9, 0.1)
    return TbmGrid(GridGeometry(0.1, 0.0, 0.0, 60, 60), masses)


def groups(*sizes):
    names = iter("abcdefgh")
    return [Group({next(names): SE2.identity() for _ in range(size)}) for size in sizes]


def count(picture, colour):
    return int((picture == colour).all(axis=2).sum())


def test_each_group_has_its_colour_and_maps_alone_have_none(grid):
    alone = draw_fleet(groups(1, 1), [], [], grid)
    assert count(alone, BLUE) == 0
    two = draw_fleet(groups(2, 2), [], [], grid)
    assert count(two, BLUE) == pytest.approx(count(two, VERMILION), rel=0.05)
    assert count(two, BLUE) > 100


def test_accepted_alignments_are_lines_of_their_group(grid):
    bare, joined = (draw_fleet(groups(2, 1), pairs, [("a", "b")], grid) for pairs in ([], [("a", "b")]))
    assert count(joined, BLUE) > count(bare, BLUE) + 100


def test_the_map_lies_beside_it_with_its_walls_up(grid):
    picture = draw_fleet(groups(2), [], [], grid)
    right = picture[:, -picture.shape[0] :, 0].astype(int)
    rows = np.flatnonzero((right == 0).sum(axis=1) > 50)
    assert 0 < len(rows) < 200
    assert rows.max() < picture.shape[0] / 2
