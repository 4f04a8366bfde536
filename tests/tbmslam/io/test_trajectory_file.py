import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2, compose, inverse, log
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.trajectory_file import TumError, read_reference, read_tum, write_g2o, write_tum
from tbmslam.map.drive import Drive, DriveLinks, DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.slam import Slam
from tests.processes import python

STAMPS = np.array([1303134554.020000001, 1303134554.070000172, 1303134554.120000124])
POSES = np.array([[0.0, 0.0, 0.0], [-1.25, 2.5, math.pi / 2], [1e-9, -1234.5678, -math.pi]])
GOLDEN = Path(__file__).resolve().parents[2] / "golden" / "vinyslam"


def test_lines_are_as_evo_wants_them(tmp_path):
    write_tum(tmp_path / "t.tum", Trajectory(STAMPS, POSES))
    lines = (tmp_path / "t.tum").read_text().split("\n")
    assert lines[1] == "1303134554.070000172 -1.250000000 2.500000000 0 0 0 0.707106781187 0.707106781187"
    assert lines[-1] == ""
    assert all(line == line.strip() for line in lines)


def test_what_is_written_is_read(tmp_path):
    write_tum(tmp_path / "t.tum", Trajectory(STAMPS, POSES))
    trajectory = read_tum(tmp_path / "t.tum")
    np.testing.assert_array_equal(trajectory.stamps, STAMPS)
    np.testing.assert_allclose(trajectory.poses, POSES, atol=1e-9)


def test_other_programs_files_are_read(tmp_path):
    # Tabs, comments, an empty line, Windows' line ends, and a quaternion of the other sign.
    text = "# stamp x y z qx qy qz qw\r\n\r\n1 2\t3  4 0 0 -0.7071068 -0.7071068\r\n"
    (tmp_path / "t.tum").write_text(text)
    trajectory = read_tum(tmp_path / "t.tum")
    assert trajectory.stamps.tolist() == [1.0]
    np.testing.assert_allclose(trajectory.poses, [[2.0, 3.0, math.pi / 2]], atol=1e-7)


def test_a_tilted_pose_keeps_its_heading(tmp_path):
    # Yaw 1, then roll 0.3 about the robot's own axis.
    qw, qx, qy, qz = (
        math.cos(0.5) * math.cos(0.15),
        math.cos(0.5) * math.sin(0.15),
        math.sin(0.5) * math.sin(0.15),
        math.sin(0.5) * math.cos(0.15),
    )
    (tmp_path / "t.tum").write_text(f"1 2 3 4 {qx} {qy} {qz} {qw}\n")
    assert read_tum(tmp_path / "t.tum").poses[0, 2] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty: give a trajectory.s file"),
        ("# only a comment\n", "holds no poses"),
        ("1 2 3 0 0 0 0 1\n1 2 3\n", r"t\.tum:2: has 3 fields, not the 8"),
        ("1 2 3 0 0 0 zero 1\n", r"t\.tum:1: could not convert string to float: 'zero'"),
        ("1 nan 3 0 0 0 0 1\n", r"t\.tum:1: has a number that is not finite"),
        ("1 2 3 0 0 0 0 0\n", r"t\.tum:1: the quaternion has length 0, not 1"),
        ("1 2 3 0 0 0 0 1\n1 2 3 0 1 1 1 1\n", r"t\.tum:2: the quaternion has length 2, not 1"),
        ("\xff\xfe", "is not text"),
    ],
)
def test_an_invalid_trajectory_is_reported_in_one_line(tmp_path, text, message):
    (tmp_path / "t.tum").write_bytes(text.encode("latin-1"))
    with pytest.raises(TumError, match=message) as caught:
        read_tum(tmp_path / "t.tum")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(TumError, match=r"none\.tum: cannot be read: No such file"):
        read_tum(tmp_path / "none.tum")


def test_the_original_programs_trajectory_is_read():
    trajectory = read_tum(GOLDEN / "HC.tum")
    assert len(trajectory) == 60
    assert trajectory.length() > 0.0


EVO = Path(sys.executable).with_name("evo_traj")


@pytest.mark.skipif(not EVO.exists(), reason="evo is not installed")
def test_evo_accepts_it(tmp_path):
    write_tum(tmp_path / "t.tum", Trajectory(STAMPS, POSES))
    run = python(EVO, "tum", "t.tum", "--full_check", cwd=tmp_path, HOME=str(tmp_path))
    assert run.returncode == 0, run.stderr
    assert re.search(r"nr\. of poses\s+3\b", run.stdout)


STAMPS_REFERENCE_TRAJECTORY = 1295936788.25 + 0.05 * np.arange(40)
POSES_REFERENCE_TRAJECTORY = np.column_stack(
    (np.linspace(0.0, 3.0, 40), np.linspace(1.0, -2.0, 40), np.linspace(-3.1, 3.1, 40))
)
T_ROBOT_LASER = SE2(0.275, -0.02, 0.1)


@pytest.fixture
def laser_file(tmp_path):
    """Write where the laser was as the data set has it."""
    lasers = compose(POSES_REFERENCE_TRAJECTORY, np.array(T_ROBOT_LASER))
    lines = [
        f"{round(t * 1e6)},{x:.9f}, {y:.9f},{a:.9f}"
        for t, (x, y, a) in zip(STAMPS_REFERENCE_TRAJECTORY, lasers, strict=True)
    ]
    path = tmp_path / "2011-01-25-06-29-26.gt.laser.poses"
    path.write_text("# of the laser\n" + "\n".join(lines) + "\n")
    return path


def test_the_data_set_s_own_truth_is_of_the_laser(laser_file):
    reference = read_reference(laser_file)
    assert reference.frame == "laser"
    robot = reference.of_robot(T_ROBOT_LASER)
    np.testing.assert_allclose(robot.stamps, STAMPS_REFERENCE_TRAJECTORY, atol=1e-6)
    np.testing.assert_allclose(robot.poses, POSES_REFERENCE_TRAJECTORY, atol=1e-8)


def test_a_tum_file_is_of_the_robot(tmp_path):
    write_tum(tmp_path / "t.tum", Trajectory(STAMPS_REFERENCE_TRAJECTORY, POSES_REFERENCE_TRAJECTORY))
    reference = read_reference(tmp_path / "t.tum")
    assert reference.frame == "robot"
    np.testing.assert_allclose(reference.of_robot(T_ROBOT_LASER).poses, POSES_REFERENCE_TRAJECTORY, atol=1e-8)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1295936788250000,1.0,2.0", r"poses:2: is not 't, x, y, theta' with t in whole microseconds"),
        ("1295936788.25,1.0,2.0,0.1", r"poses:2: is not 't, x, y, theta' with t in whole microseconds"),
        ("1295936788250000 1.0 2.0 0.1", r"poses:2: is not 't, x, y, theta' with t in whole microseconds"),
        ("1295936788250000,1.0,two,0.1", r"poses:2: could not convert string to float: 'two': remove the line"),
        ("1295936788250000,1.0,nan,0.1", r"poses:2: is not finite, or more than"),
        ("1295936788250000,1.0,2.0,inf", r"poses:2: is not finite, or more than"),
    ],
)
def test_an_invalid_pose_is_reported_with_its_line(tmp_path, line, message):
    path = tmp_path / "a.gt.laser.poses"
    path.write_text(f"1295936788200000,1.0,2.0,0.1\n{line}\n")
    with pytest.raises(TumError, match=message):
        read_reference(path)


def test_an_empty_file_is_no_truth(tmp_path):
    (tmp_path / "a.gt.laser.poses").write_text("")
    with pytest.raises(TumError, match="is empty: give a trajectory"):
        read_reference(tmp_path / "a.gt.laser.poses")


MOUNT = SE2(0.25, 0.0, 0.0)


def drive(name, poses, **more):
    scans = [LaserScan(float(k), 0.0, 0.1, 0.1, 10.0, np.array([2.0])) for k in range(len(poses))]
    way = Trajectory(np.arange(float(len(poses))), np.array(poses).reshape(-1, 3))
    return Drive(name, way, Keyframes.from_scans(scans, poses, [MOUNT] * len(poses)), **more)


def test_two_drives_are_numbered_one_after_the_other(tmp_path):
    information = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.25], [0.5, 0.25, 2.0]])
    motions = DriveMotions(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5]]), np.array([information, 2.0 * information]))
    first = drive("a", [SE2(0, 0, 0), SE2(1, 0, 0), SE2(1, 1, 0.5)], closures=np.array([[0, 2]]), motions=motions)
    write_g2o(tmp_path / "graph.g2o", [first, drive("b", [SE2(5, 5, 0)]), drive("c", [])])
    assert (tmp_path / "graph.g2o").read_text().splitlines() == [
        "VERTEX_SE2 0 0.25 0 0",
        "VERTEX_SE2 1 1.25 0 0",
        f"VERTEX_SE2 2 {1.0 + 0.25 * np.cos(0.5):.9g} {1.0 + 0.25 * np.sin(0.5):.9g} 0.5",
        "VERTEX_SE2 3 5.25 5 0",
        "EDGE_SE2 0 1 1 0 0 4 1 0.5 3 0.25 2",
        "EDGE_SE2 1 2 0 1 0.5 8 2 1 6 0.5 4",
        "# drive a: vertices 0 to 2",
        "# loop closure 0 2",
        "# drive b: vertices 3 to 3",
        "# drive c: no vertices",
    ]


def test_measured_loops_are_edges_like_other_motions(tmp_path):
    information = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.25], [0.5, 0.25, 2.0]])
    loop = DriveMotions(np.array([[1.0, 1.5, 0.5]]), information[None])
    alone = drive("a", [SE2(0, 0, 0)])
    closed = drive("b", [SE2(5, 5, 0), SE2(6, 5, 0)], closures=np.array([[0, 1]]), closure_motions=loop)
    write_g2o(tmp_path / "graph.g2o", [alone, closed])
    assert (tmp_path / "graph.g2o").read_text().splitlines() == [
        "VERTEX_SE2 0 0.25 0 0",
        "VERTEX_SE2 1 5.25 5 0",
        "VERTEX_SE2 2 6.25 5 0",
        "EDGE_SE2 1 2 1 1.5 0.5 4 1 0.5 3 0.25 2",
        "# drive a: vertices 0 to 0",
        "# drive b: vertices 1 to 2",
    ]


def test_loops_between_drives_are_edges_between_their_vertices(tmp_path):
    drives = [drive("a", [SE2(0, 0, 0), SE2(1, 0, 0)]), drive("b", [SE2(5, 5, 0), SE2(6, 5, 0)])]
    link = DriveLinks(np.array([[1, 1, 0, 0]]), DriveMotions(np.array([[-6.0, -5.0, 0.0]]), np.eye(3)[None]))
    write_g2o(tmp_path / "graph.g2o", drives, link)
    edges = [line for line in (tmp_path / "graph.g2o").read_text().splitlines() if line.startswith("EDGE")]
    assert edges == ["EDGE_SE2 3 0 -6 -5 0 1 0 0 1 0 1"]


def test_the_edges_of_a_drive_with_loops_agree_with_its_vertices(drive_in, tmp_path):
    slam = Slam()
    for reading in drive_in("apartment", 90.0).readings:
        slam.process(reading)
    (drive_with_loops,) = slam.finish().drives
    write_g2o(tmp_path / "graph.g2o", [drive_with_loops])
    words = [line.split() for line in (tmp_path / "graph.g2o").read_text().splitlines()]
    vertices = np.array([word[1:] for word in words if word[0] == "VERTEX_SE2"], dtype=np.float64)
    edges = np.array([word[1:] for word in words if word[0] == "EDGE_SE2"], dtype=np.float64)
    np.testing.assert_array_equal(vertices[:, 0], np.arange(len(drive_with_loops.keyframes)))
    ends, measured = edges[:, :2].astype(int), edges[:, 2:5]
    np.testing.assert_array_equal(ends[: len(vertices) - 1], np.arange(len(vertices) - 1)[:, None] + [0, 1])
    loops = ends[len(vertices) - 1 :]
    np.testing.assert_array_equal(loops, drive_with_loops.closures)
    assert len(loops) >= 2
    assert (loops[:, 1] - loops[:, 0]).min() > 5
    poses = vertices[:, 1:]
    errors = log(compose(inverse(measured), compose(inverse(poses[ends[:, 0]]), poses[ends[:, 1]])))
    assert np.hypot(*errors[:, :2].T).max() < 0.1
    assert np.abs(errors[:, 2]).max() < math.radians(2.0)
    information = np.zeros((len(edges), 3, 3))
    information[:, *np.triu_indices(3)] = edges[:, 5:]
    information += np.swapaxes(np.triu(information, 1), 1, 2)
    deviations = np.sqrt(np.einsum("ei,eij,ej->e", errors, information, errors))
    assert np.median(deviations) < 3.0
