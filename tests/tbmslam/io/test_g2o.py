import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.trajectory_file import write_g2o
from tbmslam.map.drive import Drive, DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan

MOUNT = SE2(0.25, 0.0, 0.0)


def drive(name, poses, **more):
    scans = [LaserScan(float(k), 0.0, 0.1, 0.1, 10.0, np.array([2.0])) for k in range(len(poses))]
    way = Trajectory(np.arange(float(len(poses))), np.array(poses))
    return Drive(name, way, Keyframes.from_scans(scans, poses, [MOUNT] * len(poses)), **more)


def test_two_drives_are_numbered_one_after_the_other(tmp_path):
    information = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.25], [0.5, 0.25, 2.0]])
    motions = DriveMotions(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5]]), np.array([information, 2.0 * information]))
    first = drive("a", [SE2(0, 0, 0), SE2(1, 0, 0), SE2(1, 1, 0.5)], closures=np.array([[0, 2]]), motions=motions)
    write_g2o(tmp_path / "graph.g2o", [first, drive("b", [SE2(5, 5, 0)])])
    assert (tmp_path / "graph.g2o").read_text().splitlines() == [
        "# drive a",
        "VERTEX_SE2 0 0.25 0 0",
        "VERTEX_SE2 1 1.25 0 0",
        f"VERTEX_SE2 2 {1.0 + 0.25 * np.cos(0.5):.9g} {1.0 + 0.25 * np.sin(0.5):.9g} 0.5",
        "EDGE_SE2 0 1 1 0 0 4 1 0.5 3 0.25 2",
        "EDGE_SE2 1 2 0 1 0.5 8 2 1 6 0.5 4",
        "# loop closure 0 2",
        "# drive b",
        "VERTEX_SE2 3 5.25 5 0",
    ]
