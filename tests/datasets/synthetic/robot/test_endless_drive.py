import itertools

import numpy as np
import pytest

from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import EndlessDrive, OdometryNoise

LASER = SimulatedLaser(beams=180, angle_min=-np.pi / 2, angle_increment=np.pi / 180, rate=5.0)


def drive(route, length, odometry="none"):
    return EndlessDrive(route, length, LASER, OdometryNoise.preset(odometry), seed=2)


def test_round_stays_and_spiral_leaves():
    around, outwards = drive("round", 100.0).truth(), drive("spiral", 260.0).truth()
    assert around.length() == pytest.approx(100.0, abs=1.0)
    assert np.ptp(around.poses[:, :2], axis=0).max() < 21.0
    assert np.ptp(outwards.poses[:, 0]) > 99.0
    assert np.ptp(outwards.poses[:, 1]) > 99.0


def test_readings_fit_the_truth_and_come_again():
    simulated = drive("round", 15.0)
    truth, readings = simulated.truth(), list(simulated.readings())
    assert [reading.scan.stamp for reading in readings] == truth.stamps.tolist()
    again = list(itertools.islice(simulated.readings(), 30))
    np.testing.assert_array_equal(again[29].scan.ranges, readings[29].scan.ranges)
    T_world_odom = truth.pose(0) @ readings[0].T_odom_robot.inverse()
    assert T_world_odom @ readings[-1].T_odom_robot == pytest.approx(truth.pose(len(truth) - 1), abs=1e-6)
    # The corridor is 2.4 m wide, so something stands at most 1.3 m to the right, a niche apart.
    assert np.median([reading.scan.ranges[0] for reading in readings]) == pytest.approx(1.2, abs=0.3)


def test_good_wheels_drift():
    simulated = drive("round", 15.0, "good")
    last = [reading.T_odom_robot for reading in simulated.readings()][-1]
    truth = simulated.truth()
    assert last != pytest.approx(truth.pose(0).inverse() @ truth.pose(len(truth) - 1), abs=1e-4)


def test_what_cannot_be_driven():
    with pytest.raises(ValueError, match="route must be one of round, spiral, got 'home'"):
        drive("home", 1.0)
    with pytest.raises(ValueError, match=r"length must be positive, got 0\.0"):
        drive("round", 0.0)
