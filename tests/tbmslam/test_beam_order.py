import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from tbmslam import beam_order
from tbmslam.beam_order import BACKWARDS, BeamOrderTrial
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import SlamConfig, preset
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2
from tbmslam.slam import Slam


def driven(clockwise):
    """Return a robot that turns fast, and its readings with rising angles, whichever way its laser turns."""
    world = make_world("apartment", 2)
    sign = -1.0 if clockwise else 1.0
    laser = SimulatedLaser(180, -sign * math.pi, math.radians(2) * sign, rate=10.0, sweep=0.1, range_max=20.0)
    robot = simulate(
        world, plan_drives(world, 1, length=25.0, seed=2, speed=1.0), laser, OdometryNoise.preset("good"), 2
    )[0]
    return robot, [r.with_scan(r.scan.backwards()) if clockwise else r for r in robot.readings]


@pytest.fixture(scope="module")
def clockwise():
    return driven(clockwise=True)


@pytest.fixture(scope="module")
def anticlockwise():
    return driven(clockwise=False)


def mapped(readings, **config):
    slam = Slam(changed(SlamConfig(), config))
    poses = [slam.process(reading) for reading in readings]
    tbm_map = slam.finish()
    return tbm_map, [incident.what for incident in slam.incidents], poses


def without_trial(monkeypatch):
    monkeypatch.setattr(BeamOrderTrial, "of", lambda *_: None)


@pytest.mark.parametrize("odometry", [True, False])
def test_a_laser_that_turns_clockwise(clockwise, odometry, monkeypatch):
    robot, readings = clockwise
    if not odometry:
        readings = [replace(r, T_odom_robot=None, T_odom_swept=None) for r in readings]
    found, incidents, _ = mapped(readings)
    assert BACKWARDS in incidents
    error = align_trajectories(robot.truth, found.drives[0].trajectory).ate_m
    assert error < 0.008
    without_trial(monkeypatch)
    stated, incidents, _ = mapped(readings)
    assert BACKWARDS not in incidents
    assert error < 0.5 * align_trajectories(robot.truth, stated.drives[0].trajectory).ate_m


def test_a_laser_that_turns_as_stated_is_mapped_as_without_a_trial(anticlockwise, monkeypatch):
    _, readings = anticlockwise
    found, incidents, poses = mapped(readings)
    assert BACKWARDS not in incidents
    without_trial(monkeypatch)
    stated, _, stated_poses = mapped(readings)
    assert poses == stated_poses
    np.testing.assert_array_equal(found.grid.masses, stated.grid.masses)


def test_the_poses_continue_where_the_order_changes(clockwise):
    _, readings = clockwise
    _, _, poses = mapped(readings)
    steps = [math.hypot(*before.to(after)[:2]) for before, after in pairwise(poses)]
    assert max(steps) < 0.2


@pytest.mark.parametrize(
    ("scan", "config"),
    [
        ({"time_increment": 0.0}, SlamConfig()),
        ({}, changed(SlamConfig(), {"deskew": {"enabled": False}})),
        ({}, preset("viny")),
    ],
    ids=["no times", "no compensation", "another tracker"],
)
def test_there_is_no_trial_where_the_order_does_not_matter(clockwise, scan, config):
    reading = clockwise[1][0]
    assert BeamOrderTrial.of(reading, SlamConfig(), None) is not None
    assert BeamOrderTrial.of(reading.with_scan(replace(reading.scan, **scan)), config, None) is None


def test_a_trial_that_decides_nothing_ends(clockwise, monkeypatch):
    trial = BeamOrderTrial.of(clockwise[1][0], SlamConfig(), None)
    for number in range(3 * 99):
        trial._count(0.1 * (-1.0) ** (number // 3))
        assert not trial.is_decided()
    for _ in range(3):
        trial._count(0.1)
    assert trial.is_decided()
    assert not trial.is_better()


@pytest.mark.parametrize(("gain", "is_better"), [(0.1, True), (-0.1, False)])
def test_equal_gains_decide_as_soon_as_they_are_many(clockwise, gain, is_better):
    trial = BeamOrderTrial.of(clockwise[1][0], SlamConfig(), None)
    counted = 0
    while not trial.is_decided():
        trial._count(gain)
        counted += 1
    assert counted == beam_order._ALIKE * math.ceil(beam_order._SURE**2)
    assert trial.is_better() is is_better


def test_only_turns_count(clockwise):
    """A robot that drives straight on, with scans that fit either way."""
    trial = BeamOrderTrial.of(clockwise[1][0], SlamConfig(), None)
    place = Slam()._drive.add
    for number, reading in enumerate(clockwise[1][:40]):
        straight = replace(reading, T_odom_robot=SE2(0.01 * number, 0.0, 0.0), T_odom_swept=None)
        still = straight.with_scan(replace(clockwise[1][0].scan, stamp=reading.scan.stamp))
        trial.observe(still, place(still))
    assert trial._gains.groups == 0
