import base64
import sys

import cv2
import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive, DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.map_check import MapFileError
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan


def test_moving_a_map_moves_its_drives_and_takes_the_grid_given():
    pose = SE2(1.0, 2.0, 0.5)
    scan = LaserScan(7.0, 0.0, 0.1, 0.1, 10.0, np.array([2.0]))
    drive = Drive(
        "robot_0", Trajectory(np.array([7.0]), np.array([pose])), Keyframes.from_scans([scan], [pose], [pose])
    )
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 2, 2))
    elsewhere = TbmGrid.unknown(GridGeometry(0.1, 5.0, 5.0, 3, 3))
    T_new_old = SE2(-3.0, 1.0, 2.0)
    moved = TbmMap(grid, (drive,), {"seed": 1}).moved(T_new_old, elsewhere)
    assert moved.grid is elsewhere
    assert moved.provenance == {"seed": 1}
    assert moved.drives[0].name == "robot_0"
    assert moved.drives[0].trajectory.pose(0) == pytest.approx(T_new_old @ pose)
    assert moved.drives[0].keyframes.pose(0) == pytest.approx(T_new_old @ pose)


def test_closures_are_between_keyframes_of_the_drive():
    nowhere = Trajectory(np.zeros(0), np.zeros((0, 3))), Keyframes.from_scans([], [], [])
    with pytest.raises(ValueError, match=r"closures must be between the 0 keyframes"):
        Drive("robot_0", *nowhere, np.array([(0, 1)]))
    with pytest.raises(ValueError, match=r"closures must have shape \(C, 2\), got \(3, 1\)"):
        Drive("robot_0", *nowhere, np.zeros((3, 1), dtype=np.int64))


def test_motions_are_between_keyframes_of_the_drive():
    nowhere = Trajectory(np.zeros(0), np.zeros((0, 3))), Keyframes.from_scans([], [], [])
    with pytest.raises(ValueError, match=r"there must be one motion less than the 0 keyframes, got 2"):
        Drive("robot_0", *nowhere, motions=DriveMotions(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1))))


def test_keyframes_are_poses_of_the_trajectory():
    scan, pose = LaserScan(7.0, 0.0, 0.1, 0.1, 10.0, np.array([2.0])), SE2.identity()
    way = Trajectory(np.arange(4.0), np.zeros((4, 3)))
    assert Drive("r", way, Keyframes.from_scans([scan], [pose], [pose], [3])).keyframes.indices.tolist() == [3]
    with pytest.raises(ValueError, match=r"keyframes must be among the 4 poses of the trajectory, got index 4"):
        Drive("r", way, Keyframes.from_scans([scan], [pose], [pose], [4]))
    Drive("r", Trajectory(np.zeros(0), np.zeros((0, 3))), Keyframes.from_scans([scan], [pose], [pose], [4]))


def test_a_map_may_be_nothing_but_a_grid():
    alone = TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 2, 2)))
    assert alone.drives == ()
    assert alone.provenance == {}


def test_steps_are_counted():
    assert len(DriveMotions(np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)))) == 4
    assert len(DriveMotions(np.zeros((0, 3)), np.zeros((0, 3, 3)))) == 0


@pytest.mark.parametrize(
    ("steps", "informations", "message"),
    [
        (
            np.zeros((2, 3)),
            np.zeros((3, 3, 3)),
            r"must have shapes \(S, 3\) and \(S, 3, 3\), got \(2, 3\) and \(3, 3, 3\)",
        ),
        (np.full((1, 3), np.nan), np.eye(3)[None], "must be finite"),
        (np.zeros((1, 3)), np.full((1, 3, 3), np.inf), "must be finite"),
        (
            np.zeros((1, 3)),
            np.array([[[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]),
            "must be symmetric and pos",
        ),
        (np.zeros((1, 3)), 1e13 * np.eye(3)[None], "with eigenvalues from 1e-12 to 1e\\+12"),
        (np.zeros((1, 3)), np.diag([1.0, 0.0, 1.0])[None], "must be symmetric and positive definite"),
    ],
)
def test_what_is_no_motion_is_refused(steps, informations, message):
    with pytest.raises(ValueError, match=message):
        DriveMotions(steps, informations)


def test_a_map_is_shown_in_a_line_and_as_a_picture():
    pose, scan = SE2(1.0, 2.0, 0.5), LaserScan(7.0, 0.0, 0.1, 0.1, 10.0, np.array([2.0]))
    keyframes = Keyframes.from_scans([scan], [pose], [pose])
    drive = Drive("robot_0", Trajectory(np.array([7.0]), np.array([pose])), keyframes)
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 2, 3))
    assert repr(drive) == "Drive('robot_0', 1 poses, 1 keyframes)"
    assert repr(TbmMap(grid, (drive,))) == "TbmMap(3 x 2 cells of 0.1 m, 0.0 m2 known; drives of robot_0)"
    assert repr(TbmMap(grid)) == "TbmMap(3 x 2 cells of 0.1 m, 0.0 m2 known)"
    assert TbmMap(grid)._repr_png_() == grid._repr_png_()
    shown = TbmMap(grid)._repr_html_()
    assert shown.startswith(f'<p>{TbmMap(grid)!r}</p><img alt="the map" src="data:image/png;base64,')
    assert base64.b64decode(shown.partition("base64,")[2].partition('"')[0]) == grid._repr_png_()
    nothing = TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 0, 0)))
    assert nothing._repr_html_() == f"<p>{nothing!r}</p>"


OCCUPANCY = np.array([[0, 100, -1], [50, 80, 20]], dtype=np.int8)


def test_a_map_from_an_array_of_occupancies_and_back():
    tbm_map = TbmMap.from_occupancy(OCCUPANCY, 0.5, (-1.0, 2.0))
    assert tbm_map.grid.geometry == GridGeometry(0.5, -1.0, 2.0, 2, 3)
    assert tbm_map.grid.fault() is None
    np.testing.assert_array_equal(tbm_map.to_occupancy(), [[0, 100, -1], [-1, 100, 0]])
    np.testing.assert_array_equal(tbm_map.grid.is_known(), [[True, True, False], [False, True, True]])
    again = TbmMap.from_occupancy(tbm_map.to_occupancy(), 0.5, (-1.0, 2.0))
    np.testing.assert_array_equal(again.to_occupancy(), tbm_map.to_occupancy())


@pytest.mark.parametrize(
    ("occupancy", "resolution", "message"),
    [
        (OCCUPANCY[0], 0.05, r"must be integers \(rows, cols\), got int8 of shape \(3,\)"),
        (OCCUPANCY / 100.0, 0.05, "must be integers"),
        (OCCUPANCY[:0], 0.05, "must be integers"),
        (OCCUPANCY.astype(int) + 1, 0.05, "must be from -1 to 100, got 0 to 101"),
        (OCCUPANCY, 0.0, "resolution must be positive, got 0"),
        (OCCUPANCY, np.nan, "resolution must be positive, got nan"),
    ],
)
def test_arrays_that_are_no_map_are_refused(occupancy, resolution, message):
    with pytest.raises(ValueError, match=message):
        TbmMap.from_occupancy(occupancy, resolution)


def test_a_picture_means_what_it_means_to_nav2(tmp_path):
    picture = np.full((4, 6), 205, dtype=np.uint8)
    picture[0], picture[3, :2] = 255, 0
    cv2.imwrite(str(tmp_path / "plan.png"), picture)
    tbm_map = TbmMap.from_image(tmp_path / "plan.png", 0.1, (3.0, -2.0))
    assert tbm_map.grid.geometry == GridGeometry(0.1, 3.0, -2.0, 4, 6)
    expected = np.full((4, 6), -1)
    expected[3], expected[0, :2] = 0, 100  # the first row of the array has the smallest y
    np.testing.assert_array_equal(tbm_map.to_occupancy(), expected)
    with pytest.raises(MapFileError, match=r"plan\.png: cells of 500 m are not within"):
        TbmMap.from_image(tmp_path / "plan.png", 500.0)
    with pytest.raises(MapFileError, match=r"none\.png: the map's image cannot be read: No such file"):
        TbmMap.from_image(tmp_path / "none.png", 0.1)


def driven_map():
    pose, scan = SE2(1.0, 2.0, 0.5), LaserScan(7.0, 0.0, 0.1, 0.1, 10.0, np.array([2.0]))
    drive = Drive(
        "robot_0", Trajectory(np.array([7.0]), np.array([pose])), Keyframes.from_scans([scan], [pose], [pose])
    )
    occupancy = np.random.default_rng(5).choice([-1, 0, 100], (30, 40)).astype(np.int8)
    return TbmMap(TbmMap.from_occupancy(occupancy, 0.1, (-1.0, 0.5)).grid, (drive,))


def test_a_part_of_a_map_lies_where_it_lay():
    whole = driven_map()
    part = whole.crop(-0.5, 1.0, 0.25, 2.0)
    assert part.grid.geometry == pytest.approx((0.1, -0.5, 1.0, 10, 8))
    np.testing.assert_array_equal(part.to_occupancy(), whole.to_occupancy()[5:15, 5:13])
    assert part.drives == whole.drives
    np.testing.assert_array_equal(whole.crop(-99.0, -99.0, 99.0, 99.0).grid.masses, whole.grid.masses)
    with pytest.raises(ValueError, match=r"\(9, 9\) to \(10, 10\) m holds no cell of"):
        whole.crop(9, 9, 10, 10)


def test_a_map_turns_with_its_drives():
    whole = driven_map()
    turned = whole.rotate(np.pi / 2.0)
    np.testing.assert_array_equal(turned.to_occupancy(), np.rot90(whole.to_occupancy(), axes=(1, 0)))
    assert turned.drives[0].trajectory.pose(0) == pytest.approx((-2.0, 1.0, 0.5 + np.pi / 2.0))
    back = turned.rotate(-np.pi / 2.0)
    assert back.grid.geometry == pytest.approx(whole.grid.geometry)
    np.testing.assert_array_equal(back.to_occupancy(), whole.to_occupancy())


def test_cells_of_another_size_cover_the_same():
    whole = driven_map()
    finer = whole.resample(0.05)
    np.testing.assert_array_equal(finer.to_occupancy(), np.kron(whole.to_occupancy(), np.ones((2, 2), dtype=np.int8)))
    assert whole.resample(0.3).grid.geometry == pytest.approx((0.3, -1.0, 0.5, 10, 14))
    with pytest.raises(ValueError, match="resolution must be positive, got 0"):
        whole.resample(0.0)


def test_a_plot_without_matplotlib_states_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ModuleNotFoundError, match=r"plot\(\) needs matplotlib.*: pip install matplotlib"):
        driven_map().plot()


def test_a_map_is_drawn_in_metres():
    pytest.importorskip("matplotlib", reason="matplotlib is not installed").use("Agg")
    axes = driven_map().plot()
    (picture,) = axes.get_images()
    assert picture.get_extent() == pytest.approx([-1.0, 3.0, 0.5, 3.5])
    np.testing.assert_array_equal(np.asarray(picture.get_array()) > 0.6, driven_map().to_occupancy() == 0)
    (line,) = axes.get_lines()
    assert line.get_xydata().tolist() == [[1.0, 2.0]]
    assert driven_map().plot(axes) is axes
