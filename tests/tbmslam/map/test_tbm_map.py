import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import Drive, DriveMotions, TbmMap
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
    with pytest.raises(ValueError, match=r"motions must be one less than the 0 keyframes, got 2"):
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
