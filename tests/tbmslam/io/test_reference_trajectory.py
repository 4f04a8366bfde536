import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2, compose
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.reference_trajectory import read_reference
from tbmslam.io.tum import TumError, write_tum

STAMPS = 1295936788.25 + 0.05 * np.arange(40)
POSES = np.column_stack((np.linspace(0.0, 3.0, 40), np.linspace(1.0, -2.0, 40), np.linspace(-3.1, 3.1, 40)))
T_ROBOT_LASER = SE2(0.275, -0.02, 0.1)


@pytest.fixture
def laser_file(tmp_path):
    """Write where the laser was as the data set has it."""
    lasers = compose(POSES, np.array(T_ROBOT_LASER))
    lines = [f"{round(t * 1e6)},{x:.9f}, {y:.9f},{a:.9f}" for t, (x, y, a) in zip(STAMPS, lasers, strict=True)]
    path = tmp_path / "2011-01-25-06-29-26.gt.laser.poses"
    path.write_text("# of the laser\n" + "\n".join(lines) + "\n")
    return path


def test_the_data_set_s_own_truth_is_of_the_laser(laser_file):
    reference = read_reference(laser_file)
    assert reference.frame == "laser"
    robot = reference.of_robot(T_ROBOT_LASER)
    np.testing.assert_allclose(robot.stamps, STAMPS, atol=1e-6)
    np.testing.assert_allclose(robot.poses, POSES, atol=1e-8)


def test_a_tum_file_is_of_the_robot(tmp_path):
    write_tum(tmp_path / "t.tum", Trajectory(STAMPS, POSES))
    reference = read_reference(tmp_path / "t.tum")
    assert reference.frame == "robot"
    np.testing.assert_allclose(reference.of_robot(T_ROBOT_LASER).poses, POSES, atol=1e-8)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1295936788250000,1.0,2.0", r"poses:2: is not 't, x, y, theta' with t in whole microseconds"),
        ("1295936788.25,1.0,2.0,0.1", r"poses:2: is not 't, x, y, theta' with t in whole microseconds"),
        ("1295936788250000 1.0 2.0 0.1", r"poses:2: is not 't, x, y, theta' with t in whole microseconds"),
        ("1295936788250000,1.0,two,0.1", r"poses:2: could not convert string to float: 'two': leave the line out"),
        ("1295936788250000,1.0,nan,0.1", r"poses:2: is not finite, or more than"),
        ("1295936788250000,1.0,2.0,inf", r"poses:2: is not finite, or more than"),
    ],
)
def test_what_is_no_pose_is_told_with_its_line(tmp_path, line, message):
    path = tmp_path / "a.gt.laser.poses"
    path.write_text(f"1295936788200000,1.0,2.0,0.1\n{line}\n")
    with pytest.raises(TumError, match=message):
        read_reference(path)


def test_an_empty_file_is_no_truth(tmp_path):
    (tmp_path / "a.gt.laser.poses").write_text("")
    with pytest.raises(TumError, match="is empty: give a trajectory"):
        read_reference(tmp_path / "a.gt.laser.poses")
