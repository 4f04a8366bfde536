import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.rendering import InsertionConfig, ScanInserter, render
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.sensing.sensor_model import SensorModelConfig
from tbmslam.slam import Slam
from tbmslam.tracking.deskew import DeskewConfig, deskewed

CONFIG = DeskewConfig()
MOUNT = SE2(0.3, -0.1, 0.4)


def scan(ranges, time_increment=0.001):
    return LaserScan(5.0, -1.0, 0.01, 0.0, 30.0, np.asarray(ranges, dtype=float), time_increment)


small = st.floats(-0.4, 0.4)


@given(st.builds(SE2, small, small, small), st.integers(2, 60), st.integers(0, 2**32 - 1))
def test_hits_lie_where_the_beams_of_the_moving_laser_end(T_robot_swept, beams, seed):
    ranges = np.random.default_rng(seed).uniform(0.5, 9.0, beams)
    moved = deskewed(scan(ranges, 0.5), T_robot_swept, MOUNT, CONFIG)
    start = SE2.identity()
    for beam, point in enumerate(moved.hit_points()):
        T_robot_then = SE2.identity().interpolate(T_robot_swept, beam / (beams - 1))
        laser = MOUNT.inverse() @ T_robot_then @ MOUNT
        angle = -1.0 + 0.01 * beam
        end = ranges[beam] * np.array([math.cos(angle), math.sin(angle)])
        np.testing.assert_allclose(point, laser.apply(end), atol=1e-9)
        np.testing.assert_allclose([start.x, start.y], [laser.x, laser.y], atol=1e-9)
        start = start @ moved.beam_step


@pytest.mark.parametrize(
    ("original", "motion", "config"),
    [
        (scan([1.0, 2.0, 3.0]), SE2(0.001, 0, 0), DeskewConfig(enabled=False)),
        (scan([1.0, 2.0, 3.0], time_increment=0.0), SE2(0.001, 0, 0), CONFIG),
        (scan([1.0]), SE2(0.001, 0, 0), CONFIG),
        (scan([1.0, 2.0, 3.0]), SE2(0.1, 0, 0), CONFIG),
        (scan([1.0, 2.0, 3.0]), SE2(0, 0, 0.1), CONFIG),
    ],
    ids=["switched off", "time unknown", "one beam", "jump", "spin"],
)
def test_some_scans_stay_as_they_are(original, motion, config):
    assert deskewed(original, motion, MOUNT, config) is original


def test_the_fastest_motion_of_a_robot_is_taken_out():
    original = scan([1.0, 2.0, 3.0])
    sweep = original.sweep()
    for fastest in (SE2(CONFIG.max_speed * sweep, 0, 0), SE2(0, 0, CONFIG.max_turn_rate * sweep)):
        assert deskewed(original, fastest, MOUNT, CONFIG) is not original


def test_the_map_is_drawn_from_where_the_beams_were_sent():
    """A wall 2 m ahead of a laser that drives along it, seen square to it by every beam."""
    beams = 41
    still = LaserScan(0.0, 0.0, 0.0, 0.0, 9.0, np.full(beams, 2.0), 0.01)
    moved = deskewed(still, SE2(0.0, 1.0, 0.0), SE2.identity(), CONFIG)
    keyframes = Keyframes.from_scans([moved], [SE2(0.013, 0.013, 0.0)], [SE2.identity()])
    assert keyframes.scan(0).beam_step == moved.beam_step
    config = changed(SlamConfig(), {}).map
    grid = render([keyframes], config)
    wall = grid.masses[:, -1, 2] > grid.masses[:, -1, 1]
    assert len(wall) == 21
    assert wall.all()
    evidence = EvidenceGrid(0.05)
    ScanInserter(SensorModelConfig(wall_blur=0), InsertionConfig()).insert(
        keyframes.scan(0), keyframes.sensor_pose(0), evidence
    )
    inserted = evidence.to_tbm_grid().cropped_to_known()
    assert inserted.geometry == pytest.approx(grid.geometry)
    assert inserted.is_known().all()  # a band of parallel beams, not a fan


@pytest.fixture(scope="module")
def turning_robot():
    """Return a robot that turns fast, with a laser that takes the whole 0.1 s between scans for a turn of its own."""
    world = make_world("apartment", 2)
    laser = SimulatedLaser(
        beams=180, angle_min=-math.pi, angle_increment=math.radians(2), rate=10.0, sweep=0.1, range_max=20.0
    )
    drives = plan_drives(world, 1, length=25.0, seed=2, speed=1.0)
    return simulate(world, drives, laser, OdometryNoise.preset("good"), 2)[0]


def ate(robot, readings, **config):
    slam = Slam(changed(SlamConfig(), config))
    for reading in readings:
        slam.process(reading)
    return align_trajectories(robot.truth, slam.finish().drives[0].trajectory).ate_m


@pytest.mark.parametrize("odometry", ["to the last beam", "at the first beam", "none"])
def test_the_error_falls_with_the_motion_taken_out(turning_robot, odometry):
    readings = turning_robot.readings
    if odometry != "to the last beam":
        readings = [replace(r, T_odom_swept=None) for r in readings]
    if odometry == "none":
        readings = [replace(r, T_odom_robot=None) for r in readings]
    error = ate(turning_robot, readings)
    assert error < 0.008
    assert error < 0.4 * ate(turning_robot, readings, deskew={"enabled": False})
