import math

import numpy as np
import pytest

from datasets.synthetic.robot.ring_lidar import RingLidar
from tbmslam.sensing.laser_scan import LaserScan

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
