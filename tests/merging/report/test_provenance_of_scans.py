from dataclasses import replace

import numpy as np
import pytest

from merging.report.provenance import drives_given_twice
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import Drive, TbmMap
from tbmslam.sensing.laser_scan import LaserScan


def map_of(grid, stamps, ranges):
    scans = [
        LaserScan(stamp, -1.0, 0.5, 0.1, 30.0, np.full(5, distance))
        for stamp, distance in zip(stamps, ranges, strict=True)
    ]
    keyframes = Keyframes.from_scans(scans, *[[SE2.identity()] * len(scans)] * 2)
    return TbmMap(grid, (Drive("robot", Trajectory(np.array(stamps), np.zeros((len(stamps), 3))), keyframes),))


@pytest.fixture
def grid():
    return TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 4, 4))


def test_a_drive_that_is_given_twice_is_found_whatever_its_frame(grid):
    stamps = [0.1 * k for k in range(10)]
    first = map_of(grid, stamps, range(1, 11))
    moved = first.drives[0].transformed(SE2(3.0, -1.0, 0.5))
    merged = replace(first, drives=(map_of(grid, stamps, [20.0] * 10).drives[0], moved))
    assert drives_given_twice({"a": first, "b": merged}) == [("a", "b", 10, 10)]


@pytest.mark.parametrize(
    ("stamps", "ranges"),
    [
        ([0.1 * k for k in range(10)], [15.0] * 10),  # two simulated robots that began together
        ([5.0 + 0.1 * k for k in range(10)], range(1, 11)),  # a robot before the same wall at other times
        ([0.1 * k for k in range(10)], [1, 2, 3, 4, 5, *[15.0] * 5]),  # two cut from one recording share a half
        ([], []),
    ],
)
def test_other_drives_are_not_taken_for_one(grid, stamps, ranges):
    maps = {"a": map_of(grid, [0.1 * k for k in range(10)], range(1, 11)), "b": map_of(grid, stamps, ranges)}
    assert drives_given_twice({**maps, "no drives": TbmMap(grid)}) == []
