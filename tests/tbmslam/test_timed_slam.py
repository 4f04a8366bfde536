import numpy as np
import pytest

from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import EndlessDrive, OdometryNoise
from tbmslam.configuration.slam_config import preset
from tbmslam.slam import Slam
from tbmslam.timed_slam import TimedSlam


@pytest.fixture(scope="module")
def readings():
    laser = SimulatedLaser(beams=181, angle_min=-np.pi / 2, angle_increment=np.pi / 180, rate=5.0)
    return list(EndlessDrive("round", 6.0, laser, OdometryNoise.preset("good")).readings())


@pytest.mark.parametrize("name", ["default", "viny", "viny-hc"])
def test_it_maps_as_the_plain_one_does_and_every_part_is_timed(name, readings):
    plain, timed = Slam(preset(name)), TimedSlam(preset(name))
    for reading in readings:
        assert plain.process(reading) == timed.process(reading)
    expected, found = plain.finish(), timed.finish()
    np.testing.assert_array_equal(found.grid.masses, expected.grid.masses)
    np.testing.assert_array_equal(found.drives[0].trajectory.poses, expected.drives[0].trajectory.poses)
    assert min(timed.seconds.values()) > 0.0
