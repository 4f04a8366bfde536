import math

import numpy as np
import pytest

from datasets.synthetic.robot.laser import RingLidar, SimulatedLaser
from datasets.synthetic.world.world import World
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan

ROOM = World("room", 0, np.array([[-2.0, -3, 4, -3], [4, -3, 4, 1], [4, 1, -2, 1], [-2, 1, -2, -3]]), np.zeros((1, 2)))
PERFECT = {"noise": 0.0, "dropouts": 0.0, "wrong_returns": 0.0}


def scan_of(laser, pose=SE2(0.0, 0.0, 0.0), world=ROOM, seed=0):  # noqa: B008 - SE2 cannot be changed
    return laser.scans(world, np.array([5.0]), np.array([pose]), np.random.default_rng(seed))[0]


def test_the_default_is_statas_laser():
    scan = scan_of(SimulatedLaser())
    assert len(scan.ranges) == 1040
    assert scan.angle_min == pytest.approx(-2.26892805)
    assert scan.angle_min + 1039 * scan.angle_increment == pytest.approx(2.26456, abs=1e-4)
    assert (scan.stamp, scan.range_max) == (5.0, 30.0)


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("mount", [SE2(0.275, 0, 0), SE2(-0.1, 0.2, 2.5)])
def test_hits_lie_on_the_walls_wherever_the_laser_is_mounted(mount, upside_down):
    laser = SimulatedLaser(beams=361, angle_increment=0.0125, T_robot_sensor=mount, upside_down=upside_down, **PERFECT)
    pose = SE2(0.5, -0.8, 0.6)
    points = (pose @ mount).apply(scan_of(laser, pose).hit_points())
    assert len(points) == 361
    off = np.min(
        [np.abs(points[:, 0] + 2), np.abs(points[:, 0] - 4), np.abs(points[:, 1] + 3), np.abs(points[:, 1] - 1)], axis=0
    )
    assert off.max() < 1e-5


def test_a_hanging_lasers_beams_turn_the_other_way():
    scan = scan_of(SimulatedLaser(upside_down=True))
    assert scan.angle_increment < 0 < scan.angle_min


def test_noise_has_the_size_it_should_and_no_mean():
    laser = SimulatedLaser(noise=0.02, dropouts=0.0, wrong_returns=0.0)
    error = scan_of(laser).ranges - scan_of(SimulatedLaser(**PERFECT)).ranges
    assert abs(error.mean()) < 0.003
    assert 0.018 < error.std() < 0.022


def test_some_beams_return_nothing_and_some_too_early():
    exact = scan_of(SimulatedLaser(**PERFECT)).ranges
    lost = scan_of(SimulatedLaser(noise=0.0, dropouts=0.1, wrong_returns=0.0)).ranges
    assert 0.06 < np.isinf(lost).mean() < 0.14
    early = scan_of(SimulatedLaser(noise=0.0, dropouts=0.0, wrong_returns=0.1)).ranges
    wrong = early < exact - 1e-6
    assert 0.06 < wrong.mean() < 0.14
    np.testing.assert_array_equal(early[~wrong], exact[~wrong])


def test_what_is_too_far_or_too_near_returns_nothing():
    ranges = scan_of(SimulatedLaser(range_max=2.5, **PERFECT)).ranges
    assert np.isinf(ranges).any()
    assert ranges[np.isfinite(ranges)].max() <= 2.5
    near = scan_of(SimulatedLaser(range_min=1.9, T_robot_sensor=SE2(0, 0, 0), **PERFECT)).ranges
    assert near.min() >= 1.9


def test_a_wall_nearer_than_the_least_range_may_return_too_early():
    laser = SimulatedLaser(range_min=2.5, noise=0.0, dropouts=0.0, wrong_returns=1.0)
    ranges = scan_of(laser).ranges
    assert np.isfinite(ranges).sum() > 100
    assert ranges[np.isfinite(ranges)].min() >= 2.5


def test_ranges_are_what_a_message_can_hold():
    scan = scan_of(SimulatedLaser())
    np.testing.assert_array_equal(scan.ranges, scan.ranges.astype(np.float32))
    assert scan.angle_increment == float(np.float32(scan.angle_increment))


def test_usual_lasers():
    assert SimulatedLaser.field_of(180) == pytest.approx((-math.pi / 2, math.radians(1)))
    assert SimulatedLaser.field_of(361) == pytest.approx((-math.pi / 2, math.radians(0.5)))
    assert SimulatedLaser.field_of(1040) == pytest.approx((-2.26892805, 0.00436332))
    assert SimulatedLaser.field_of(520)[1] == pytest.approx(2 * 0.00436332)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"beams": 0}, "beams must be positive, got 0"),
        ({"rate": 0.0}, r"rate must be positive, got 0\.0"),
        ({"rate": math.inf}, "rate must be at most 10000 Hz and noise at most range_max, got inf"),
        ({"noise": 1e300}, r"noise at most range_max, got 20\.0, 1e\+300"),
        ({"dropouts": 2.0}, r"dropouts and wrong_returns must be at most 1, got 2\.0"),
        ({"T_robot_sensor": SE2(math.nan, 0.0, 0.0)}, "T_robot_sensor must be finite and within 100 m, got"),
        ({"noise": -0.1}, r"noise must not be negative, got -0\.1"),
        ({"range_max": 0.01}, r"range_max must be finite and above range_min, got 0\.023, 0\.01"),
        ({"beams": 2000}, "beams must lie within one turn, got 2000 steps"),
        ({"angle_increment": 0.0}, "beams must lie within one turn"),
    ],
)
def test_impossible_lasers_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        SimulatedLaser(**wrong)


SCAN = LaserScan(1.0, -math.pi, math.radians(1.0), 0.1, 30.0, np.append(np.full(359, 4.0), np.inf), 1e-4)


def seen(lidar, noise=0.0, *, upside_down=False):
    return lidar.points(SCAN, noise, np.random.default_rng(1), upside_down=upside_down)


def test_rings_meet_floor_walls_and_ceiling():
    points, times = seen(RingLidar(5, math.radians(-30.0), math.radians(30.0)))
    level, heights = np.hypot(points[:, 0], points[:, 1]), points[:, 2] + 0.6
    assert len(points) == 359 * 5  # what returned nothing is left out
    rings = level.reshape(-1, 5)
    np.testing.assert_allclose(rings[:, 0], 0.6 / math.tan(math.radians(30.0)), rtol=1e-5)
    np.testing.assert_allclose(rings[:, 1:4], [[0.6 / math.tan(math.radians(15.0)), 4.0, 4.0]] * 359, rtol=1e-5)
    np.testing.assert_allclose(rings[:, 4], 1.9 / math.tan(math.radians(30.0)), rtol=1e-5)
    np.testing.assert_allclose((heights.min(), heights.max()), (0.0, 2.5), atol=1e-5)
    np.testing.assert_allclose(times, np.repeat(1e-4 * np.arange(359), 5), rtol=1e-5)


def test_rings_differ_by_noise_and_a_hanging_one_is_mirrored():
    lidar = RingLidar(3, 0.0, 0.0)
    assert 0.008 < np.std(np.hypot(*seen(lidar, 0.01).points[:, :2].T)) < 0.012
    upright, hanging = seen(RingLidar()).points, seen(RingLidar(), upside_down=True).points
    np.testing.assert_array_equal(hanging, upright * (1.0, -1.0, -1.0))


@pytest.mark.parametrize("values", [{"rings": 0}, {"height": 3.0}, {"height": 0.0}, {"lowest": 1.0, "highest": 0.5}])
def test_what_a_lidar_cannot_be(values):
    with pytest.raises(ValueError, match="must be"):
        RingLidar(**values)
