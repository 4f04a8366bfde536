import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Let one worker simulate the drives for all of their tests."""
    for item in items:
        if "drive_in" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group("drives"))


@pytest.fixture(scope="session")
def drive_in():
    """Return a function that simulates a robot's drive in a world, remembered for the session."""
    made = {}

    def drive(world, length, odometry="poor", seed=0, beams=181):
        key = (world, length, odometry, seed, beams)
        if key not in made:
            building = make_world(world, seed)
            angle_min, angle_increment = SimulatedLaser.field_of(beams)
            laser = SimulatedLaser(beams=beams, angle_min=angle_min, angle_increment=angle_increment, rate=5.0)
            drives = plan_drives(building, 1, length=length, seed=seed)
            made[key] = simulate(building, drives, laser, OdometryNoise.preset(odometry), seed)[0]
        return made[key]

    return drive


@pytest.fixture
def generator():
    return np.random.default_rng(0)
