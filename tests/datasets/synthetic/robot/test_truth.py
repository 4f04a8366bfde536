import json

import numpy as np

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.odometry_noise import OdometryNoise
from datasets.synthetic.robot.simulation import simulate
from datasets.synthetic.robot.truth import tum_text, write_truth
from datasets.synthetic.world.world import load_world
from tbmslam.geometry.trajectory import Trajectory


def test_truth_files_say_where_robots_were(tmp_path):
    world = make_world("corridor", 2)
    drives = plan_drives(world, 2, duration=5.0)
    robots = simulate(world, drives, SimulatedLaser(beams=20), OdometryNoise.preset("good"))
    write_truth(tmp_path, world, robots, ["robot_0.bag", "robot_1"], {"seed": 3})
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["seed"] == 3
    assert truth["source"] == "the simulated world, ground truth"
    assert truth["world"] == {"name": "corridor", "seed": 2, "file": "world.npz"}
    assert truth["laser"]["beams"] == 20
    np.testing.assert_array_equal(load_world(tmp_path).walls, world.walls)
    for robot, entry in zip(robots, truth["robots"], strict=True):
        table = np.loadtxt(tmp_path / entry["trajectory"])
        np.testing.assert_allclose(table[:, 0], robot.truth.stamps, atol=1e-6)
        np.testing.assert_allclose(table[:, 1:3], robot.truth.poses[:, :2], atol=1e-8)
        yaw = 2 * np.arctan2(table[:, 6], table[:, 7])
        np.testing.assert_allclose(np.cos(yaw - robot.truth.poses[:, 2]), 1.0)
        np.testing.assert_allclose(entry["T_world_robot"], robot.truth.poses[0])
        assert entry["scans"] == 100
    assert [entry["trajectory"] for entry in truth["robots"]] == ["robot_0.truth.tum", "robot_1.truth.tum"]
    assert len(list(tmp_path.iterdir())) == 4


def test_tum_has_nine_digits_and_no_space_at_the_end():
    text = tum_text(Trajectory(np.array([1300000000.05]), np.array([[1.0, -2.0, np.pi / 2]])))
    assert text == "1300000000.049999952 1.000000000 -2.000000000 0 0 0 0.707106781 0.707106781\n"
