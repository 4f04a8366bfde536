from dataclasses import replace

import numpy as np
import pytest

from merging.report.provenance import duplicate_drives, incidents_of, warnings_of
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan

JUMPED = [{"stamp": 1.0, "what": "the odometry jumps"}]
LOST = [{"stamp": 2.0, "what": "lost"}]
ONE = {"warnings": ["a gap"], "incidents": JUMPED}
OTHER = {"warnings": [], "incidents": LOST}


def map_of(drives: int, provenance: dict[str, object]) -> TbmMap:
    way = Trajectory(np.array([0.0]), np.zeros((1, 3)))
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 2, 2))
    return TbmMap(grid, (Drive("robot", way, Keyframes.from_scans([], [], [])),) * drives, provenance)


def part(drives: int, provenance: dict[str, object]) -> dict[str, object]:
    return {"pose": [0.0, 0.0, 0.0], "drives": drives, "provenance": provenance}


def test_each_drive_of_a_merge_keeps_its_trouble():
    two = {"merged_from": {"a": part(1, ONE), "plan": part(0, {"read_from": "plan.yaml"}), "b": part(1, OTHER)}}
    assert incidents_of(map_of(2, two)) == [JUMPED, LOST]
    again = {"merged_from": {"c": part(1, OTHER), "ab": part(2, two)}}
    assert incidents_of(map_of(3, again)) == [LOST, JUMPED, LOST]
    assert warnings_of(again) == ["ab: a: a gap"]


def test_warnings_of_several_merged_maps_are_joined():
    merged = {"merged_from": {"a": part(1, ONE), "b": part(1, OTHER), "c": part(1, ONE)}}
    assert warnings_of(merged) == ["a, c: a gap"]
    assert warnings_of({"merged_from": {"x": part(3, merged), "y": part(3, merged)}}) == ["x, y: a, c: a gap"]


def test_a_single_drive_has_its_own():
    assert incidents_of(map_of(1, ONE)) == [JUMPED]
    assert incidents_of(map_of(0, ONE)) == []
    assert warnings_of(ONE) == ["a gap"]


def test_incidents_without_an_owner_are_ignored():
    before = {name: {"pose": [0.0, 0.0, 0.0], "provenance": ONE} for name in "ab"}
    assert incidents_of(map_of(2, {"merged_from": before})) == [None, None]
    assert incidents_of(map_of(2, {"merged_from": {"a": 3, "b": {"provenance": []}}})) == [None, None]
    assert incidents_of(map_of(2, {"merged_from": {"a": part(-1, ONE), "b": part(3, ONE)}})) == [None, None]


def scanned_map(grid, stamps, ranges):
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
    first = scanned_map(grid, stamps, range(1, 11))
    moved = first.drives[0].transformed(SE2(3.0, -1.0, 0.5))
    merged = replace(first, drives=(scanned_map(grid, stamps, [20.0] * 10).drives[0], moved))
    assert duplicate_drives({"a": first, "b": merged}) == [("a", "b", 10, 10)]


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
    maps = {"a": scanned_map(grid, [0.1 * k for k in range(10)], range(1, 11)), "b": scanned_map(grid, stamps, ranges)}
    assert duplicate_drives({**maps, "no drives": TbmMap(grid)}) == []
