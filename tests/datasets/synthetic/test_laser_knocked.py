"""A simulated laser that is knocked."""

import numpy as np

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.faults import Fault, inject
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate


def test_a_knocked_laser_is_rotated_by_ten_degrees():
    world = make_world("apartment", 4)
    angle_min, step = SimulatedLaser.field_of(181)
    laser = SimulatedLaser(beams=181, angle_min=angle_min, angle_increment=step, rate=5.0)
    robot = simulate(world, plan_drives(world, 1, duration=5.0, seed=4), laser, OdometryNoise.preset("none"), 4)[0]
    knocked = inject(robot, Fault("laser_knocked", 2.0, 60.0), world, 1)
    for k, (one, other) in enumerate(zip(robot.readings, knocked.readings, strict=True)):
        if k < 10:
            assert other is one
        else:
            np.testing.assert_array_equal(other.scan.ranges[:-10], one.scan.ranges[10:])
            assert np.isnan(other.scan.ranges[-10:]).all()
