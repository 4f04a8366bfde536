import math

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.edits import MapEdit, angle_to_axes, keepout_mask, without_scans
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan

FREE_MAP = TbmMap.from_occupancy(np.zeros((20, 30), dtype=np.int8), 0.1, (-1.0, 0.0))


def occupancy(kind, *values, of=FREE_MAP):
    return MapEdit(kind, values).applied(of).to_occupancy()


@pytest.mark.parametrize(("kind", "value"), [("erase", -1), ("occupy", 100)])
def test_a_rectangle_is_painted_from_any_corner(kind, value):
    expected = np.zeros((20, 30), dtype=np.int8)
    expected[5:10, 10:15] = value
    for corners in ((0.0, 0.5, 0.5, 1.0), (0.5, 1.0, 0.0, 0.5), (0.5, 0.5, 0.0, 1.0)):
        np.testing.assert_array_equal(occupancy(kind, *corners), expected)
    np.testing.assert_array_equal(FREE_MAP.to_occupancy(), 0)  # the map itself stays


def test_what_is_freed_is_free():
    assert (occupancy("free", -9, -9, 9, 9, of=TbmMap.from_occupancy(np.full((3, 3), 100), 0.1)) == 0).all()


def test_a_wall_is_a_line_without_gaps():
    wall = occupancy("wall", -0.95, 0.05, 1.95, 1.95)
    rows, cols = np.nonzero(wall == 100)
    assert set(cols) == set(range(30))
    assert len(rows) < 30 + 20
    assert np.abs(rows * 0.1 + 0.05 - (0.05 + 1.9 / 2.9 * cols * 0.1)).max() <= 0.1
    steps = np.abs(np.diff(rows[np.lexsort((rows, cols))]))
    assert steps.max() <= 1
    assert (occupancy("wall", 0.0, 0.0, 0.0, 99.0) == 100).sum() == 20  # what lies outside is left out


def test_crop_and_rotate_change_the_frame_as_the_map_does():
    assert MapEdit("crop", (1.0, 1.5, 0.0, 0.5)).applied(FREE_MAP).grid.geometry == pytest.approx((0.1, 0, 0.5, 10, 10))
    turned = MapEdit("rotate", (90.0,)).applied(FREE_MAP).grid.geometry
    assert turned == pytest.approx((0.1, -2.0, -1.0, 30, 20))


@pytest.mark.parametrize("kind", ["crop", "erase", "free", "occupy", "wall"])
def test_a_part_without_cells_is_refused(kind):
    said = r"\(50, 50\) to \(60, 60\) m holds no cell of the map, which reaches from \(-1\.00, 0\.00\) to"
    with pytest.raises(ValueError, match=said):
        MapEdit(kind, (50, 50, 60, 60)).applied(FREE_MAP)


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        ("paint", (1, 2, 3, 4), "an edit must be one of crop, .*, wall, got 'paint'"),
        ("wall", (1, 2, 3), "wall takes 4 numbers, got 3"),
        ("rotate", (math.nan,), "the numbers of rotate must be within 100000"),
        ("crop", (0, 0, 1, math.inf), "the numbers of crop must be within"),
    ],
)
def test_what_is_no_edit_is_refused(kind, values, message):
    with pytest.raises(ValueError, match=message):
        MapEdit(kind, values)


@pytest.mark.parametrize("degrees", [-40.0, -12.3, 0.0, 7.0, 33.0, 44.0])
def test_the_turn_to_the_axes_undoes_another(degrees):
    cells = np.full((200, 300), -1, dtype=np.int8)
    cells[40:160, 40:260] = 0
    cells[40:160, [40, 41, 150, 151, 258, 259]] = 100
    cells[[40, 41, 158, 159], 40:260] = 100
    turned = TbmMap.from_occupancy(cells, 0.05).rotate(math.radians(degrees))
    assert angle_to_axes(turned.grid) == pytest.approx(-degrees, abs=0.5)
    assert angle_to_axes(FREE_MAP.grid) == 0.0


def test_a_new_mask_is_empty():
    mask = keepout_mask(GridGeometry(0.1, 0.0, 0.0, 4, 5))
    assert (mask.to_occupancy() == 0).all()


def test_scans_are_left_out_and_trajectories_stay():
    pose, scan = SE2(1.0, 2.0, 0.5), LaserScan(7.0, 0.0, 0.1, 0.1, 10.0, np.array([2.0]))
    way = Trajectory(np.array([7.0]), np.array([pose]))
    drive = Drive("robot_0", way, Keyframes.from_scans([scan], [pose], [pose]))
    (kept,) = without_scans(TbmMap(FREE_MAP.grid, (drive,))).drives
    assert (kept.name, len(kept.trajectory), len(kept.keyframes)) == ("robot_0", 1, 0)
