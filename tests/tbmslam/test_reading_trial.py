import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import SlamConfig, preset
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2
from tbmslam.reading_trial import BACKWARDS, PairedGains, ReadingTrial
from tbmslam.sensing.laser_scan import Corrections
from tbmslam.slam import Slam

# One worker simulates the drives for all of them.
pytestmark = pytest.mark.xdist_group("reading trial")

STRETCHED = math.pi / 179


def turning(clockwise):
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
    return turning(clockwise=True)


@pytest.fixture(scope="module")
def anticlockwise():
    return turning(clockwise=False)


def mapped(readings, **options):
    slam = Slam(**options)
    poses = [slam.process(reading) for reading in readings]
    tbm_map = slam.finish()
    return tbm_map, [incident.what for incident in slam.incidents], poses


def without_trial(monkeypatch):
    monkeypatch.setattr(ReadingTrial, "of", lambda *_: None)


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
    assert ReadingTrial.of(reading, SlamConfig(), None) is not None
    assert ReadingTrial.of(reading.with_scan(replace(reading.scan, **scan)), config, None) is None


def observed(reading, gains):
    """Yield the trial of a drive that turns fast, after each scan that fits better by a gain the other way round."""
    trial = ReadingTrial.of(reading, SlamConfig(), None)
    trial.rival = SimpleNamespace(add=lambda placement: placement.other)
    for number, gain in enumerate(gains):
        scan = replace(reading.scan, stamp=0.1 * number)
        here = SimpleNamespace(scan=scan, T_map_robot=SE2(0.0, 0.0, 0.1 * number), match=SimpleNamespace(score=0.5))
        here.other = SimpleNamespace(match=SimpleNamespace(score=0.5 + gain))
        trial.observe(here, here)
        yield trial


def test_a_trial_that_decides_nothing_ends(clockwise):
    gains = [0.1 * (-1.0) ** ((number - 1) // 3) for number in range(3 * 100 + 1)]
    decided = [(trial.is_decided(), trial.is_better()) for trial in observed(clockwise[1][0], gains)]
    assert decided == [(False, False)] * 300 + [(True, False)]


@pytest.mark.parametrize(("gain", "is_better"), [(0.1, True), (-0.1, False)])
def test_equal_gains_decide_as_soon_as_they_are_many(clockwise, gain, is_better):
    """n equal gains are sqrt(n) standard deviations, and 3.5 decide."""
    states = observed(clockwise[1][0], [gain] * 100)
    counted, decided = next((n, trial) for n, trial in enumerate(states) if trial.is_decided())
    assert counted == 3 * 13
    assert decided.is_better() is is_better


def test_only_turns_count(clockwise):
    """A robot that drives straight on, with scans that fit either way."""
    trial = ReadingTrial.of(clockwise[1][0], SlamConfig(), None)
    place = Slam()._drive.add
    for number, reading in enumerate(clockwise[1][:40]):
        straight = replace(reading, T_odom_robot=SE2(0.01 * number, 0.0, 0.0), T_odom_swept=None)
        still = straight.with_scan(replace(clockwise[1][0].scan, stamp=reading.scan.stamp))
        trial.observe(still, place(still))
    assert trial._gains.groups == 0


def stretched(step):
    """Return a robot whose laser has a step, and its readings with a stretched one."""
    world = make_world("office", 3)
    laser = SimulatedLaser(180, -0.5 * math.pi, step, rate=5.0, range_max=30.0)
    robot = simulate(
        world, plan_drives(world, 1, length=80.0, seed=3, speed=0.8), laser, OdometryNoise.preset("poor"), 3
    )[0]
    return robot, [r.with_scan(replace(r.scan, angle_increment=STRETCHED)) for r in robot.readings]


@pytest.fixture(scope="module")
def converted():
    return stretched(math.radians(1.0))


def test_a_stretched_step_is_undone(converted):
    robot, readings = converted
    tbm_map, incidents, _ = mapped(readings)
    drive = tbm_map.drives[0]
    assert "scans fit better where beams are 1 degrees apart, not 1.0056: they are read so" in incidents
    assert not any("walls fit best" in what for what in incidents)
    assert math.degrees(drive.keyframes.beams[0, 1]) == pytest.approx(1.0)
    stated = mapped(readings, corrections=Corrections(angle_step=True))[0].drives[0]
    assert math.degrees(stated.keyframes.beams[0, 1]) == pytest.approx(180 / 179)
    errors = [align_trajectories(robot.truth, each.trajectory).ate_m for each in (drive, stated)]
    assert errors[0] < 0.8 * errors[1]


def test_a_laser_that_has_the_stated_step():
    robot, readings = stretched(STRETCHED)
    tbm_map, incidents, _ = mapped(readings)
    drive = tbm_map.drives[0]
    assert math.degrees(drive.keyframes.beams[0, 1]) == pytest.approx(180 / 179)
    assert not any("fit better" in what for what in incidents)
    assert align_trajectories(robot.truth, drive.trajectory).ate_m < 0.02


def test_the_drive_may_continue_after_the_decision(converted):
    slam = Slam()
    for reading in converted[1][:-20]:
        slam.process(reading)
    slam.finish()
    for reading in converted[1][-20:]:
        slam.process(reading)
    drive = slam.finish().drives[0]
    assert len(drive.trajectory) == len(converted[1])
    assert math.degrees(drive.keyframes.beams[-1, 1]) == pytest.approx(1.0)


def test_there_is_no_trial_of_other_steps_or_trackers(converted):
    reading = converted[1][0]
    assert ReadingTrial.of(reading, SlamConfig(), None) is not None
    assert ReadingTrial.of(reading, SlamConfig(), None, is_step_known=True) is None
    assert ReadingTrial.of(reading, preset("viny"), None) is None
    round_step = reading.with_scan(replace(reading.scan, angle_increment=math.radians(1.0)))
    assert ReadingTrial.of(round_step, SlamConfig(), None) is None


def test_scans_that_state_times_are_tried_with_the_stated_step(converted):
    reading = converted[1][0]
    timed = reading.with_scan(replace(reading.scan, time_increment=1e-4))
    assert ReadingTrial.of(timed, SlamConfig(), None).rival.finding == BACKWARDS


@given(st.lists(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=4), max_size=9))
def test_the_groups_count_by_their_means(groups):
    gains = PairedGains()
    for group in groups:
        for gain in group:
            gains.add(gain, 1.0 / len(group))
    means = np.array([np.mean(group) for group in groups])
    squares = float((means**2).sum())
    assert gains.groups == len(groups)
    assert gains.deviations() == pytest.approx(float(means.sum()) / math.sqrt(squares) if squares else 0.0, abs=1e-9)


def test_a_gain_without_share_and_an_incomplete_group_do_not_count():
    gains = PairedGains()
    gains.add(1.0, 0.5)
    gains.add(9.0, 0.0)
    assert (gains.groups, gains.deviations()) == (0, 0.0)
    gains.add(3.0, 0.5)
    assert (gains.groups, gains.deviations()) == (1, 1.0)


def test_chance_hardly_ever_exceeds_the_bound():
    rng = np.random.default_rng(0)
    signs = rng.choice([-1.0, 1.0], (20000, 60)) * rng.exponential(1.0, (20000, 60))
    sums = signs.sum(axis=1) / np.sqrt((signs**2).sum(axis=1))
    for z in (2.0, 3.0, 3.5):
        assert (sums > z).mean() <= math.exp(-0.5 * z * z)
