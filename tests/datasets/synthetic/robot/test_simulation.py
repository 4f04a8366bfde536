import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datasets import open_recording
from datasets.synthetic.bag_writing import write_ros1_bag
from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, poses_at, simulate, write_truth
from datasets.synthetic.world.world import load_world
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2, wrap_angles
from tbmslam.geometry.trajectory import Trajectory


def drive_of(twists):
    poses = [SE2(3.0, -2.0, 1.0)]
    for twist in twists:
        poses.append(poses[-1] @ SE2.exp(*twist))
    return Trajectory(np.arange(len(poses)) * 0.02, np.array(poses))


moves = st.floats(-0.02, 0.02).filter(lambda value: abs(value) > 1e-5 or value == 0.0)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(moves, moves, moves), min_size=1, max_size=30))
def test_without_noise_odometry_is_the_drive_in_its_own_frame(twists):
    drive = drive_of(twists)
    odometry = OdometryNoise.preset("none").odometry(drive, np.random.default_rng(0))
    np.testing.assert_array_equal(odometry.poses[0], 0.0)
    back = odometry.transformed(drive.pose(0))
    np.testing.assert_allclose(back.poses[:, :2], drive.poses[:, :2], atol=1e-6)
    np.testing.assert_allclose(wrap_angles(back.poses[:, 2] - drive.poses[:, 2]), 0.0, atol=1e-6)


def end_errors(preset, drive, count=60):
    noise = OdometryNoise.preset(preset)
    ends = [
        noise.odometry(drive, np.random.default_rng(seed)).transformed(drive.pose(0)).poses[-1] for seed in range(count)
    ]
    return np.hypot(*(np.array(ends)[:, :2] - drive.poses[-1, :2]).T)


def test_presets_drift_as_they_say():
    lap = [(0.01, 0.0, 0.0)] * 3000 + [(0.0, 0.0, np.pi / 2 / 100)] * 100 + [(0.01, 0.0, 0.0)] * 500
    lap += [(0.0, 0.0, np.pi / 2 / 100)] * 100
    drive = drive_of(lap * 4)
    assert drive.length() == pytest.approx(140.0)
    assert 0.2 < end_errors("good", drive).mean() < 1.0
    assert 1.5 < end_errors("poor", drive).mean() < 6.0


def test_rest_and_reversing_are_no_rotation():
    noise = OdometryNoise(alpha1=0.5, alpha2=0.0, alpha3=0.0, alpha4=0.0)
    drive = drive_of([(-0.01, 0.0, 0.0)] * 200 + [(0.0, 0.0, 0.0)] * 200)
    odometry = noise.odometry(drive, np.random.default_rng(1))
    np.testing.assert_allclose(odometry.poses[-1], [-2.0, 0.0, 0.0], atol=1e-6)


def test_spread_of_one_step_is_the_books():
    noise = OdometryNoise(alpha1=0.1, alpha2=0.2, alpha3=0.3, alpha4=0.4)
    drive = Trajectory(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [np.cos(0.3), np.sin(0.3), 0.5]]))
    ends = np.array([noise.odometry(drive, np.random.default_rng(seed)).poses[1] for seed in range(4000)])
    # turns 0.3 and 0.2, translation 1 (table 5.6, lines 5 to 7)
    assert ends[:, 2].var() == pytest.approx(0.1 * (0.3**2 + 0.2**2) + 2 * 0.2, rel=0.1)
    mean_square = (ends[:, 0] ** 2 + ends[:, 1] ** 2).mean()
    assert mean_square == pytest.approx(1.0 + 0.3 + 0.4 * (0.3**2 + 0.2**2), rel=0.1)


def test_wrong_noise_is_refused():
    with pytest.raises(ValueError, match="name must be one of none, good, poor, got 'bad'"):
        OdometryNoise.preset("bad")
    with pytest.raises(ValueError, match=r"alpha3 must not be negative, got -1\.0"):
        OdometryNoise(0.0, 0.0, -1.0, 0.0)


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


def test_a_slow_laser_is_read_from_a_bag_completely(tmp_path):
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


def test_a_drive_too_short_for_a_scan_is_refused():
    drive = Trajectory(np.array([5.0, 5.05]), np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"a drive must last at least 0\.057 s for one scan, got 0\.05 s"):
        simulate(WORLD, [drive], replace(LASER, sweep=0.05), NO_NOISE)


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
