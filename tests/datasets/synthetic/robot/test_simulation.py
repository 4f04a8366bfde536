import json
from dataclasses import replace

import numpy as np
import pytest

from datasets import open_recording
from datasets.synthetic.bag_writing import write_ros1_bag
from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.odometry_noise import OdometryNoise
from datasets.synthetic.robot.simulation import poses_at, simulate, tum_text, write_truth
from datasets.synthetic.world.world import load_world
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory

WORLD = make_world("office", 1)
DRIVES = plan_drives(WORLD, 2, duration=10.0, seed=1)
NO_NOISE = OdometryNoise.preset("none")
LASER = SimulatedLaser(beams=181, angle_increment=0.025)


def test_scans_come_at_the_lasers_rate_with_truth_and_odometry():
    robot, other = simulate(WORLD, DRIVES, LASER, OdometryNoise.preset("none"), seed=1)
    assert (robot.name, other.name) == ("robot_0", "robot_1")
    assert len(robot.readings) == len(robot.truth) == 200
    np.testing.assert_allclose(np.diff(robot.truth.stamps), 0.05, atol=1e-6)
    assert [reading.scan.stamp for reading in robot.readings] == robot.truth.stamps.tolist()
    start = DRIVES[0].pose(0)
    for index, reading in enumerate(robot.readings):
        assert reading.T_robot_sensor == LASER.T_robot_sensor
        np.testing.assert_allclose((start @ reading.T_odom_robot)[:2], robot.truth.poses[index, :2], atol=1e-6)


def test_hits_at_true_poses_lie_in_occupied_cells_and_beams_pass_free_ones():
    (robot, _) = simulate(WORLD, DRIVES, SimulatedLaser(noise=0.0, wrong_returns=0.0), OdometryNoise.preset("poor"))
    geometry = WORLD.grid(0.05)
    labels = WORLD.occupancy(geometry)

    def labels_at(points):
        cells = np.floor((points - [geometry.origin_x, geometry.origin_y]) / geometry.resolution).astype(int)
        return labels[cells[:, 1], cells[:, 0]]

    for index in range(0, 200, 40):
        reading = robot.readings[index]
        sensor = robot.truth.pose(index) @ reading.T_robot_sensor
        points = reading.scan.hit_points()
        assert len(points) > 1000
        # Walls lie anywhere within a cell: an end may round to the neighbour.
        assert (labels_at(sensor.apply(points)) == OCCUPIED).mean() > 0.98
        lengths = np.hypot(*points.T)[:, None]
        before = points * (1.0 - 0.15 / lengths)
        assert (labels_at(sensor.apply(before[lengths[:, 0] > 0.5])) == FREE).mean() > 0.9


def test_the_same_seed_gives_the_same_readings_and_another_other_noise():
    first, again, other = (
        simulate(WORLD, DRIVES[:1], LASER, OdometryNoise.preset("good"), seed=seed)[0] for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first.odometry.poses, again.odometry.poses)
    np.testing.assert_array_equal(first.readings[-1].scan.ranges, again.readings[-1].scan.ranges)
    assert not np.array_equal(first.odometry.poses, other.odometry.poses)
    assert not np.array_equal(first.readings[-1].scan.ranges, other.readings[-1].scan.ranges)


def test_a_slow_laser_comes_through_a_bag_with_all_it_tells(tmp_path):
    laser = SimulatedLaser(beams=90, angle_min=-3.1, angle_increment=0.07, rate=10.0, sweep=0.09, range_max=20.0)
    world = make_world("apartment", 3)
    robot = simulate(world, plan_drives(world, duration=8.0, seed=3), laser, NO_NOISE, 3)[0]
    still = simulate(world, plan_drives(world, duration=8.0, seed=3), replace(laser, sweep=0.0), NO_NOISE, 3)[0]
    reading, at_once = robot.readings[-1], still.readings[len(robot.readings) - 1]
    assert reading.scan.sweep() == pytest.approx(0.09)
    np.testing.assert_allclose(reading.scan.ranges[:2], at_once.scan.ranges[:2], atol=0.02)
    assert np.nanmean(np.abs(reading.scan.ranges - at_once.scan.ranges)) > 0.02
    write_ros1_bag(robot, tmp_path / "a.bag")
    read = list(open_recording([tmp_path / "a.bag"]))[-1]
    assert read.scan.time_increment == reading.scan.time_increment
    assert read.T_odom_robot.inverse() @ read.T_odom_swept == pytest.approx(
        reading.T_odom_robot.inverse() @ reading.T_odom_swept, abs=1e-4
    )


def test_poses_between_samples_follow_the_twist():
    quarter = SE2.exp(1.0, 0.0, np.pi / 2)
    trajectory = Trajectory(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], quarter]))
    poses = poses_at(trajectory, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(poses, [[0, 0, 0], SE2.exp(0.5, 0.0, np.pi / 4), quarter], atol=1e-12)


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
