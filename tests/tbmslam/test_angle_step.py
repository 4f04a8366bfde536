import math
from dataclasses import replace

import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from tbmslam.angle_step import AngleStepTrial
from tbmslam.configuration.slam_config import SlamConfig, preset
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.sensing.laser_scan import Corrections
from tbmslam.slam import Slam

STRETCHED = math.pi / 179


def driven(step):
    """Return a robot whose laser has a step, and its readings with a stretched one."""
    world = make_world("office", 3)
    laser = SimulatedLaser(180, -0.5 * math.pi, step, rate=5.0, range_max=30.0)
    robot = simulate(
        world, plan_drives(world, 1, length=80.0, seed=3, speed=0.8), laser, OdometryNoise.preset("poor"), 3
    )[0]
    return robot, [r.with_scan(replace(r.scan, angle_increment=STRETCHED)) for r in robot.readings]


@pytest.fixture(scope="module")
def converted():
    return driven(math.radians(1.0))


def mapped(readings, **options):
    slam = Slam(**options)
    for reading in readings:
        slam.process(reading)
    drive = slam.finish().drives[0]
    return drive, [incident.what for incident in slam.incidents]


def test_a_stretched_step_is_undone(converted):
    robot, readings = converted
    drive, incidents = mapped(readings)
    assert "scans fit better where beams are 1 degrees apart, not 1.0056: they are read so" in incidents
    assert not any("walls fit best" in what for what in incidents)
    assert math.degrees(drive.keyframes.beams[0, 1]) == pytest.approx(1.0)
    stated, _ = mapped(readings, corrections=Corrections(angle_step=True))
    assert math.degrees(stated.keyframes.beams[0, 1]) == pytest.approx(180 / 179)
    errors = [align_trajectories(robot.truth, each.trajectory).ate_m for each in (drive, stated)]
    assert errors[0] < 0.8 * errors[1]


def test_a_laser_that_has_the_stated_step():
    robot, readings = driven(STRETCHED)
    drive, incidents = mapped(readings)
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
    assert AngleStepTrial.of(reading, SlamConfig(), None) is not None
    assert AngleStepTrial.of(reading, preset("viny"), None) is None
    round_step = reading.with_scan(replace(reading.scan, angle_increment=math.radians(1.0)))
    assert AngleStepTrial.of(round_step, SlamConfig(), None) is None
