import numpy as np

from datasets.synthetic.buildings import make_world
from datasets.synthetic.drives import plan_drives
from datasets.synthetic.laser import SimulatedLaser
from datasets.synthetic.odometry_noise import OdometryNoise
from datasets.synthetic.simulation import poses_at, simulate
from tbmslam.belief import FREE, OCCUPIED
from tbmslam.se2 import SE2
from tbmslam.trajectory import Trajectory

WORLD = make_world("office", 1)
DRIVES = plan_drives(WORLD, 2, duration=10.0, seed=1)
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


def test_poses_between_samples_follow_the_twist():
    quarter = SE2.exp(1.0, 0.0, np.pi / 2)
    trajectory = Trajectory(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], quarter]))
    poses = poses_at(trajectory, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(poses, [[0, 0, 0], SE2.exp(0.5, 0.0, np.pi / 4), quarter], atol=1e-12)
